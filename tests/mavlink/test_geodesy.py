import math

import numpy as np
import pymap3d
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mavlink.errors import GeodesyError
from mavlink.geodesy import (
    R_ENU_NED,
    LocalFrame,
    euler_from_quaternion,
    quaternion_from_euler,
    rotation_from_euler,
    rotation_from_quaternion,
    wrap_pi,
)

LATITUDE, LONGITUDE = st.floats(-85, 85), st.floats(-180, 180)
ALTITUDE = st.floats(-400, 6000)
OFFSET = st.floats(-0.05, 0.05)
ANGLE = st.floats(-math.pi, math.pi)


@given(lat=LATITUDE, lon=LONGITUDE, alt=ALTITUDE, dlat=OFFSET, dlon=OFFSET, up=st.floats(-200, 500))
@settings(max_examples=60, deadline=None)
def test_enu_against_pymap3d_and_back(lat, lon, alt, dlat, dlon, up):
    frame = LocalFrame(lat, lon, alt)
    place = (lat + dlat, lon + dlon, alt + up)
    p_enu = frame.to_enu(*place)
    assert p_enu == pytest.approx(pymap3d.geodetic2enu(*place, lat, lon, alt), abs=1e-4)
    assert frame.to_enu_point(*place) == pytest.approx(p_enu, abs=1e-9)
    back = frame.to_geodetic(p_enu)
    assert float(back[0]) == pytest.approx(place[0], abs=1e-9)
    assert float((back[1] - place[1] + 180) % 360 - 180) == pytest.approx(0.0, abs=1e-9)
    assert float(back[2]) == pytest.approx(place[2], abs=1e-4)


def test_arrays_keep_their_shape_and_nan_stays_nan():
    frame = LocalFrame(-35.36, 149.16, 584.0)
    lat = np.full((2, 3), -35.36)
    lat[1, 2] = np.nan
    p_enu = frame.to_enu(lat, 149.16, 584.0)
    assert p_enu.shape == (2, 3, 3)
    assert np.isnan(p_enu[1, 2]).all()
    assert np.allclose(p_enu[0], 0.0, atol=1e-6)
    assert np.isnan(frame.to_geodetic(p_enu)[0][1, 2])
    assert frame.to_enu([], [], []).shape == (0, 3)


def test_directions():
    frame = LocalFrame(50.0, 10.0)
    east, north, up = frame.to_enu([50.0, 50.001, 50.0], [10.001, 10.0, 10.0], [0, 0, 7.0])
    assert east[0] > 70 and abs(east[1]) < 0.01
    assert north[1] > 110 and abs(north[0]) < 1e-6
    assert up == pytest.approx([0, 0, 7], abs=1e-6)


@pytest.mark.parametrize("place", [(91, 0, 0), (0, 181, 0), (math.nan, 0, 0), (0, 0, math.inf)])
def test_no_such_origin(place):
    with pytest.raises(GeodesyError, match="no such place"):
        LocalFrame(*place)


def test_frames_compare_by_value():
    assert LocalFrame(1, 2, 3) == LocalFrame(1.0, 2.0, 3.0)
    assert len({LocalFrame(1, 2, 3), LocalFrame(1, 2, 3)}) == 1
    assert LocalFrame(1, 2, 3) != LocalFrame(1, 2, 4)


@given(ANGLE, st.floats(-1.5, 1.5), ANGLE)
@settings(max_examples=60, deadline=None)
def test_euler_quaternion_and_matrix_are_the_same_rotation(roll, pitch, yaw):
    R = rotation_from_euler(roll, pitch, yaw)
    assert np.allclose(R @ R.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(R) == pytest.approx(1.0)
    q = quaternion_from_euler(roll, pitch, yaw)
    assert np.allclose(rotation_from_quaternion(q), R, atol=1e-12)
    assert np.allclose(rotation_from_quaternion([3 * v for v in q]), R, atol=1e-12)
    again = rotation_from_euler(*euler_from_quaternion(*(2 * v for v in q)))
    assert np.allclose(again, R, atol=1e-7)


def test_body_axes():
    # yaw 90°: the nose points east
    assert R_ENU_NED @ rotation_from_euler(0, 0, math.pi / 2) @ [1, 0, 0] == pytest.approx([1, 0, 0])
    # pitch up 30°: the nose points up by 30°
    assert (R_ENU_NED @ rotation_from_euler(0, math.radians(30), 0) @ [1, 0, 0])[2] == pytest.approx(0.5)
    # roll right: the right wing goes down
    assert (R_ENU_NED @ rotation_from_euler(math.radians(30), 0, 0) @ [0, 1, 0])[2] == pytest.approx(-0.5)


def test_ned_to_enu():
    assert np.allclose(R_ENU_NED @ [1, 2, 3], [2, 1, -3])
    assert np.isnan(rotation_from_quaternion([0, 0, 0, 0])).any()


@pytest.mark.parametrize(
    ("angle", "wrapped"), [(0, 0), (4, 4 - 2 * math.pi), (-4, 2 * math.pi - 4), (7, 7 - 2 * math.pi)]
)
def test_wrap(angle, wrapped):
    assert wrap_pi(angle) == pytest.approx(wrapped)
