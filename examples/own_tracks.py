"""Names for your own tracks by your own positions, without MAVLink and video: python examples/own_tracks.py 10"""

import sys

import numpy as np

import rollcall

(seconds,) = sys.argv[1:] or sys.exit(__doc__)
times_us = 1_700_000_000_000_000 + np.arange(0, int(seconds) * 1_000_000, 100_000)
turn = (times_us - times_us[0])[:, None] * 1e-6 * np.array([0.5, 0.7, -0.6]) + (0.0, 2.0, 4.0)
enu = np.stack([8 * np.cos(turn) + (-9, 0, 9), 6 * np.sin(turn), 0 * turn], axis=2)  # (times, 3 vehicles, xyz) metres
gps = enu + np.random.default_rng(1).normal(0.0, 0.3, enu.shape)  # what the vehicles report
eye, down = np.array([0.0, 0.0, 40.0]), np.diag([1.0, -1.0, -1.0])  # a camera 40 m up, looking down, image up is north
camera = rollcall.CameraState(R_enu_cam=down, p_enu=eye, ground_z=0.0, px_rad=1 / 1200)
identifier, row, none = rollcall.Identifier(system_ids=(11, 12, 13)), np.arange(3), np.full((3, 3), np.nan)
for t_us, seen, told in zip(times_us.tolist(), enu[:, ::-1], gps, strict=True):  # the first track is the third vehicle
    rays = (seen - eye) @ down  # from pixels: rollcall.Intrinsics(...).rays(pixels)
    others = {"gap_s": np.zeros(3), "score": np.ones(3), "front_cam": none}
    tracks = rollcall.Observation(t_us=t_us, track_id=row + 1, ray_cam=rays, **others)
    unknown = {"v_enu": none, "heading": none[0], "std_m": none[0]}
    reports = rollcall.VehicleReports(t_us=np.full(3, t_us), vehicle=row, p_enu=told, **unknown)
    names = identifier.update(tracks, camera, reports)
print(dict(zip(tracks.track_id.tolist(), names.system_id.tolist(), strict=True)), names.confidence.round(3))
