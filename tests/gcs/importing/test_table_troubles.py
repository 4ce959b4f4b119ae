"""Tables and tracks as other tools write them, and clocks and units that are not what they seem."""

import math
import re

import numpy as np
import pytest

from gcs.errors import ImportFileError
from gcs.importing.sources import read_vehicle_logs

T0_S = 1_760_000_000
ROWS = 60


def path_of(k):
    """Latitude, longitude, altitude after k half seconds."""
    return 47.1 + 4e-6 * k, 8.1 + 2e-6 * k, 430.0 + 0.01 * k


def table(header, row, rows=ROWS, end="\n"):
    return end.join([header, *(row(k, *path_of(k)) for k in range(rows))]) + end


def iso(k, zone="Z"):
    return (
        f"2025-10-09T08:53:{20 + k // 2}.{5 * (k % 2)}{zone}" if k < 80 else f"2025-10-09T08:54:{k // 2 - 40:02}{zone}"
    )


def read(tmp_path, text, name="rover.csv"):
    path = tmp_path / name
    path.write_text(text)
    (log,) = read_vehicle_logs(path)
    return log


def assert_whole(log, rows=ROWS, within_us=1):
    at = np.arange(rows)
    assert log.clock == "utc"
    assert log.places.t_us == pytest.approx(T0_S * 1_000_000 + at * 500_000, abs=within_us)
    assert log.places.lat_deg == pytest.approx(path_of(at)[0], abs=1e-9)
    assert log.places.lon_deg == pytest.approx(path_of(at)[1], abs=1e-9)
    assert log.places.alt_m == pytest.approx(path_of(at)[2], abs=1e-6)


@pytest.mark.parametrize(
    ("header", "row", "said"),
    [
        ("time,lat,lon,alt", lambda k, *p: f"{iso(k)},{p[0]:.9f},{p[1]:.9f},{p[2]}", ""),
        # Excel
        (
            "sep=;\ntime;lat;lon;alt",
            lambda k, *p: (
                f"{iso(k)};{p[0]:.9f};{p[1]:.9f};{p[2]}".replace(".", ",").replace(",5Z", ".5Z").replace(",0Z", ".0Z")
            ),
            "",
        ),
        # QGroundControl
        (
            "Timestamp,roll,pitch,heading,groundSpeed,altitudeRelative,altitudeAMSL,gps.lat,gps.lon,gps.courseOverGround",
            lambda k, *p: f"{iso(k, '').replace('T', ' ')},1.1,0.2,90,1.2,0,{p[2]},{p[0]:.9f},{p[1]:.9f},90",
            "without a zone",
        ),
        # GPSLogger
        (
            "time,lat,lon,elevation,accuracy,bearing,speed,satellites,provider",
            lambda k, *p: f"{iso(k)},{p[0]:.9f},{p[1]:.9f},{p[2]},4.5,90.0,1.2,14,gps",
            "",
        ),
        ("timestamp,lat,lon,alt", lambda k, *p: f"{T0_S + k / 2},{p[0]:.9f},{p[1]:.9f},{p[2]}", ""),
        ("timestamp,lat,lon,alt", lambda k, *p: f"{T0_S * 1000 + k * 500},{p[0]:.9f},{p[1]:.9f},{p[2]}", ""),
        ("timestamp,lat,lon,alt", lambda k, *p: f"{T0_S * 10**6 + k * 500_000},{p[0]:.9f},{p[1]:.9f},{p[2]}", ""),
        ("timestamp,lat,lon,alt", lambda k, *p: f"{T0_S * 10**9 + k * 500_000_000},{p[0]:.9f},{p[1]:.9f},{p[2]}", ""),
        (
            "time_s,lat,lon,alt",
            lambda k, *p: f"{T0_S * 1000 + k * 500},{p[0]:.9f},{p[1]:.9f},{p[2]}",
            "in ms since 1970",
        ),
        (
            "time,lat,lon,alt",
            lambda k, *p: f"{iso(k)},{p[0] * 1e7:.2f},{p[1] * 1e7:.2f},{p[2] * 1e3:.0f}",
            "lat, lon are degrees × 1e7",
        ),
        # decimal commas within quotation marks, words with what else stands between cells
        ("time,lat,lon,alt", lambda k, *p: f'"{iso(k)}","{p[0]:.9f}","{p[1]:.9f}","{p[2]}"'.replace(".", ","), ""),
        ('time,"name, of it",lat,lon,alt', lambda k, *p: f'{iso(k)},"Red, 1",{p[0]:.9f},{p[1]:.9f},{p[2]}', ""),
        # Airdata of a DJI drone
        (
            "time(millisecond),datetime(utc),latitude,longitude,height_above_takeoff(feet),"
            "altitude_above_seaLevel(feet),speed(mph), compass_heading(degrees), pitch(degrees),gimbal_pitch(degrees)",
            lambda k, *p: (
                f"{500 * k},{iso(k, '').replace('T', ' ')},{p[0]},{p[1]},98.4,{p[2] / 0.3048},3.1,20.5,1.5,-90"
            ),
            "",
        ),
        # what reads DJI's own records
        (
            "CUSTOM.updateTime [local],CUSTOM.updateTime [UTC],OSD.latitude,OSD.longitude,OSD.altitude [ft],OSD.yaw",
            lambda k, *p: f"1,{iso(k, '').replace('-', '/').replace('T', ' ')},{p[0]},{p[1]},{p[2] / 0.3048},-20",
            "",
        ),
        ("time,lat,lon,alt_ft", lambda k, *p: f"{iso(k)},{p[0]},{p[1]},{p[2] / 0.3048}", ""),
        ("time,lat,lon,altitude (feet)", lambda k, *p: f"{iso(k)},{p[0]},{p[1]},{p[2] / 0.3048}", ""),
        (
            "time,lat_rad,lon_rad,alt_cm",
            lambda k, *p: f"{iso(k)},{math.radians(p[0])},{math.radians(p[1])},{p[2] * 100}",
            "",
        ),
        (
            "time,lat,lon,alt,alt_hae",
            lambda k, *p: f"{iso(k)},{p[0]},{p[1]},{p[2]},478",
            "above the ellipsoid are not taken",
        ),
        # what writers put in front, and numpy's comment sign
        (
            "Flight log of a rover\n\nDriver;Max\n# time,Latitude (°),Longitude (°),alt",
            lambda k, *p: f"{iso(k, ' UTC').replace('T', ' ', 1)},{p[0]},{p[1]},{p[2]}",
            "",
        ),
        # hundreds of columns
        (
            f"time,{','.join(f'BATTERY.cell{n}Voltage' for n in range(400))},lat,lon,alt",
            lambda k, *p: f"{iso(k)},{'3.812,' * 400}{p[0]},{p[1]},{p[2]}",
            "",
        ),
        # MAVLink's own dump of GLOBAL_POSITION_INT, near the sea too
        (
            "timestamp,GLOBAL_POSITION_INT.time_boot_ms,GLOBAL_POSITION_INT.lat,GLOBAL_POSITION_INT.lon,"
            "GLOBAL_POSITION_INT.alt,GLOBAL_POSITION_INT.hdg",
            lambda k, *p: f"{T0_S + k / 2},{k},{p[0] * 1e7:.2f},{p[1] * 1e7:.2f},{p[2] * 1e3:.0f},65535",
            "",
        ),
        ("id,time,lat,lon,alt", lambda k, *p: f"{k + 1},{iso(k)},{p[0]:.9f},{p[1]:.9f},{p[2]}", "id counts rows"),
    ],
)
def test_the_same_path_whatever_the_tool(header, row, said, tmp_path):
    log = read(tmp_path, table(header, row))
    # the ns of a Unix time are finer than a float's
    assert_whole(log)
    assert log.system_id == 0
    assert said in " ".join(log.notes.assumed)


def test_the_latest_row_may_come_first(tmp_path):
    head, *rows = table("time,lat,lon,alt", lambda k, *p: f"{iso(k)},{p[0]:.9f},{p[1]:.9f},{p[2]}").splitlines()
    assert_whole(read(tmp_path, "\n".join([head, *reversed(rows)])))


@pytest.mark.parametrize(("unit", "factor"), [("deg", 1.0), ("rad", np.pi / 180.0), ("cdeg", 100.0)])
def test_angles_in_the_unit_of_their_name(unit, factor, tmp_path):
    text = table(
        f"time,lat,lon,alt,roll_{unit},pitch_{unit},yaw_{unit}",
        lambda k, *p: f"{iso(k)},{p[0]},{p[1]},{p[2]},{3 * factor},{-2 * factor},{(100 + k) * factor}",
    )
    log = read(tmp_path, text)
    assert np.degrees(log.attitudes.angles[7]) == pytest.approx((3.0, -2.0, 107.0))


def test_centidegrees_are_known_by_their_size(tmp_path):
    text = table("time,lat,lon,heading", lambda k, *p: f"{iso(k)},{p[0]},{p[1]},{9000 + 100 * k}")
    log = read(tmp_path, text)
    assert np.degrees(log.places.heading[3]) == pytest.approx(93.0)
    assert "heading_deg are centidegrees by their size" in log.notes.assumed


def test_a_number_for_unknown_headings_makes_no_centidegrees(tmp_path):
    text = table("time,lat,lon,heading", lambda k, *p: f"{iso(k)},{p[0]},{p[1]},{655.35 if k % 8 == 0 else 90 + k}")
    log = read(tmp_path, text)
    assert np.degrees(log.places.heading[3]) == pytest.approx(93.0)
    assert not any("centidegrees" in said for said in log.notes.assumed)


def test_the_altitude_of_litchi_counts_from_the_take_off(tmp_path):
    text = table(
        "latitude,longitude,altitude(feet),ascent(feet),speed(mph),datetime(utc),velocityX(mps),pitch(deg),heading(deg)",
        lambda k, *p: f"{p[0]},{p[1]},98.4252,98.4252,2,{iso(k, '').replace('T', ' ')},0.1,2,20",
    )
    log = read(tmp_path, text)
    assert log.places.height_m == pytest.approx(30.0, abs=1e-3) and np.isnan(log.places.alt_m).all()
    assert log.notes.assumed == ("altitude counts from the take-off, as ascent stands beside it",)


def test_thousands_and_words_are_no_decimal_numbers(tmp_path):
    text = table("time,lat,lon,alt,height", lambda k, *p: f'{iso(k)},{p[0]},{p[1]},"1,430",N/A')
    log = read(tmp_path, text)
    assert np.isnan(log.places.alt_m).all() and log.notes.skipped == {"cells that are no numbers": ROWS}


def by_time(time):
    return lambda k, *p: f"{time(k)},{p[0]},{p[1]},{p[2]}"


@pytest.mark.parametrize(
    ("header", "row", "words"),
    [
        # what ulog2csv writes: µs since boot
        (
            "timestamp,lat,lon,alt",
            by_time(lambda k: 1_093_901_788 + 200_000 * k),
            "timestamp: cannot be s, since rows are 200000 apart",
        ),
        (
            "timestamp,lat,lon,alt",
            by_time(lambda k: 65_000 + 500 * k),
            "column timestamp: cannot be s, since rows are 500 apart",
        ),
        (
            "elapsed_s,lat,lon,alt",
            by_time(lambda k: 250 * k),
            "column elapsed_s: cannot be s, since rows are 250 apart; give seconds since the film's first frame",
        ),
        ("time,lat,lon,alt", by_time(lambda k: 5 * 10**10 + k), "50000000030 is no Unix time"),
        (
            "time,lat,lon,alt",
            by_time(lambda k: f"09.10.2025 08:53:{k:02}"),
            "'09.10.2025 08:53:00' is not understood; give ISO 8601",
        ),
        (
            "time,lat,lon,alt",
            by_time(lambda k: f"10/09/2025 08:53:{k:02} AM"),
            "'10/09/2025 08:53:00 AM' is not understood",
        ),
        ("time,lat,lon,alt", by_time(lambda k: iso(0)), "all 60 positions have the same time, 2025-10-09 08:53:20"),
        # a logger that was started again
        ("time,lat,lon,alt", by_time(lambda k: iso(k % 30)), "times begin again: line 32 is 14.50 s earlier"),
        # a clock that was set back
        (
            "time_s,lat,lon,alt",
            by_time(lambda k: T0_S + k / 2 - 3600 * (k >= 20)),
            "line 22 is 3599.50 s earlier",
        ),
        (
            "time,lat,lon,yaw",
            lambda k, *p: f"{iso(k)},{p[0]},{p[1]},{0.05 * k}",
            "yaw never exceed 2.95: degrees or radians? call them yaw_deg or yaw_rad",
        ),
        ("time,lat,lon,yaw_rad", lambda k, *p: f"{iso(k)},{p[0]},{p[1]},{k}", "yaw_rad goes up to 53.1: no radians"),
        (
            "time,lat,lon,alt",
            lambda k, *p: f"{iso(k)},{p[0]},{p[1]},{100 * p[2]}",
            "alt goes up to 43053, which is 43 km: tell the unit in its name",
        ),
        ("time,lat,lon,gimbal_pitch", lambda k, *p: f"{iso(k)},{p[0]},{p[1]},-1.57", "degrees or radians"),
        (
            "time,easting,northing",
            lambda k, *p: f"{iso(k)},1,2",
            "column lat is missing; the first line must name the columns, it has time, easting",
        ),
        ("time," + 999 * "x", lambda k, *p: f"{iso(k)},1", f"it has time, {'x' * 194}"),
        ("time,lat,lon", lambda k, *p: f"{iso(k)},{p[0] * 1000},{p[1]}", "47100, 8.1 are no place in degrees"),
        (
            "time,lat,lon",
            lambda k, *p: f"{iso(k)},{p[0]},{p[1]}".replace(".", ","),
            "its rows have more cells than its first line: decimal commas need semicolons",
        ),
        (
            "time,system_id,lat,lon",
            lambda k, *p: f"{iso(k)},{1000 + k % 3},{p[0]},{p[1]}",
            "system ids are 1 to 255, not 1000",
        ),
    ],
)
def test_what_cannot_be_trusted_is_refused_in_words(header, row, words, tmp_path):
    with pytest.raises(ImportFileError, match=re.escape(words)) as error:
        read(tmp_path, table(header, row))
    assert len(str(error.value)) < 600


@pytest.mark.parametrize("name", ["rover.csv", "rover.gpx"])
@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ([*range(20), 23, 20, 21, 22, *range(24, 60)], "3 positions stand behind later ones: put in order"),
        ([*range(20), *range(40, 70)], "nothing was logged for 10.5 s after {}"),
    ],
)
def test_the_order_of_rows_is_told(name, rows, said, tmp_path):
    rows = [(iso(k), *path_of(k)) for k in rows]
    text = "time,lat,lon,alt\n" + "".join(f"{t},{lat},{lon},{alt}\n" for t, lat, lon, alt in rows)
    log = read(tmp_path, gpx_of(rows) if name.endswith("gpx") else text, name)
    assert log.notes.assumed == (said.format("position 20" if name.endswith("gpx") else "line 21"),)


@pytest.mark.parametrize("name", ["rover.csv", "rover.gpx"])
def test_whole_seconds_that_rows_share_are_spread(name, tmp_path):
    rows = [(f"2025-10-09T08:53:{20 + k // 10}Z", *path_of(k)) for k in range(3, 97)]
    text = "time,lat,lon,alt\n" + "".join(f"{t},{lat},{lon},{alt}\n" for t, lat, lon, alt in rows)
    log = read(tmp_path, gpx_of(rows) if name.endswith("gpx") else text, name)
    taken = T0_S * 1_000_000 + np.arange(3, 97) * 100_000
    assert np.abs(log.places.t_us - taken).max() <= 50_000
    assert any("10 rows share" in said for said in log.notes.assumed)


def test_a_second_behind_a_hole_is_full_at_its_end(tmp_path):
    kept = [*range(3, 36), *range(57, 97)]
    text = "time,lat,lon\n" + "".join(
        f"2025-10-09T08:53:{20 + k // 10}Z,{path_of(k)[0]},{path_of(k)[1]}\n" for k in kept
    )
    log = read(tmp_path, text)
    assert np.abs(log.places.t_us - T0_S * 1_000_000 - np.array(kept) * 100_000).max() <= 50_000
    assert not any("leaps" in said for said in log.notes.assumed)


def test_whole_seconds_with_a_count_beside_them_are_placed_by_it(tmp_path):
    """Whole seconds by Airdata: where rows are missing, their number in a second does not tell the time of each."""
    kept = [k for k in range(3, 197) if k % 7 not in (1, 2, 4)]
    text = "time(millisecond),datetime(utc),latitude,longitude\n" + "".join(
        f"{100 * k + 4321},2025-10-09 08:53:{20 + k // 10},{path_of(k)[0]},{path_of(k)[1]}\n" for k in kept
    )
    log = read(tmp_path, text)
    assert len(log.places) == len(kept)
    assert np.abs(log.places.t_us - T0_S * 1_000_000 - np.array(kept) * 100_000).max() <= 50_000
    (said,) = log.notes.assumed
    assert said == "dates are whole seconds: rows are placed by the milliseconds beside them, ±0.05 s"
    # a date that was set
    later = text.replace("08:53:2", "08:52:2")
    log = read(tmp_path, later)
    assert np.abs(log.places.t_us - T0_S * 1_000_000 - np.array(kept) * 100_000).max() <= 150_000
    assert re.search(r"the date steps by \+(59\.9|60\.0)", "; ".join(log.notes.assumed))
    # one row a second: nothing tells that dates are cut
    text = "time(millisecond),datetime(utc),latitude,longitude\n" + "".join(
        f"{1000 * k},2025-10-09 08:53:{20 + k},{path_of(k)[0]},{path_of(k)[1]}\n" for k in range(30)
    )
    assert (read(tmp_path, text).places.t_us == (T0_S + np.arange(30)) * 1_000_000).all()


def test_a_row_that_is_cut_off_is_left_out(tmp_path):
    text = table("time,lat,lon,alt", lambda k, *p: f"{iso(k)},{p[0]:.9f},{p[1]:.9f},{p[2]}")
    log = read(tmp_path, text[: text.rindex(",") - 6])
    assert_whole(log, ROWS - 1)
    assert log.notes.skipped == {"rows that are cut off": 1}
    # a row that is none is not the one that counts
    log = read(tmp_path, text + 100 * "\0")
    assert_whole(log)
    assert log.notes.skipped == {"rows without a time": 1}


def test_waypoints_are_counted(tmp_path):
    rows = [(iso(k), *path_of(k)) for k in range(9)]
    way = f'<wpt lat="47" lon="8"><time>{iso(0)}</time></wpt>'
    log = read(tmp_path, gpx_of(rows).replace("<trk>", way + "<trk>"), "rover.gpx")
    assert len(log.places) == 9 and log.notes.skipped == {"points that are of no track": 1}
    with pytest.raises(ImportFileError, match="1 points that are of no track"):
        read(tmp_path, f"<gpx>{way}</gpx>", "rover.gpx")


def test_a_table_of_ros_counts_altitudes_from_the_ellipsoid(tmp_path):
    head = "%time,field.header.seq,field.latitude,field.longitude,field.altitude"
    text = table(head, lambda k, *p: f"{T0_S * 10**9 + k * 500_000_000},{k},{p[0]},{p[1]},{p[2]}")
    log = read(tmp_path, text)
    assert log.clock == "utc" and len(log.places) == ROWS and np.isnan(log.places.alt_m).all()
    assert "heights above the ellipsoid are not taken" in log.notes.assumed[0]


def test_a_table_without_times_says_what_it_has(tmp_path):
    with pytest.raises(ImportFileError, match=r"no column of times.*, it has \.header\.stamp\.sec, lat, lon"):
        read(tmp_path, ".header.stamp.sec,lat,lon\n1,2,3\n")


def test_rows_that_repeat_a_place_within_a_second_are_not_spread(tmp_path):
    text = "time,lat,lon\n" + "".join(
        f"2025-10-09T08:53:{20 + k // 10}Z,{47 + k // 10 * 1e-5},8.1\n" for k in range(90)
    )
    log = read(tmp_path, text)
    assert len(log.places) == 9
    assert log.notes.skipped["positions with the time of another"] == 81


def gpx_of(rows, name="Rover"):
    points = "".join(
        f'<trkpt lat="{lat}" lon="{lon}"><ele>{alt}</ele><time>{t}</time></trkpt>' for t, lat, lon, alt in rows
    )
    return f'<gpx version="1.1"><trk><name>{name}</name><trkseg>{points}</trkseg></trk></gpx>'


@pytest.mark.parametrize(
    ("name", "system_id"),
    [
        ("UGV-11", 11),
        ("Rover 7", 7),
        ("Auto_2021.03.12_07.54.06", 0),
        ("2021-03-12T07:54:06", 0),
        ("20210312 rover 12", 12),
        ("track 20210312", 0),
    ],
)
def test_a_date_in_a_name_is_no_system_id(name, system_id, tmp_path):
    log = read(tmp_path, gpx_of([(iso(k), *path_of(k)) for k in range(9)], name), "rover.gpx")
    assert log.system_id == system_id


def test_clocks_of_tracks_are_judged_like_those_of_tables(tmp_path):
    same = gpx_of([(iso(0), *path_of(k)) for k in range(9)])
    with pytest.raises(ImportFileError, match="all 9 positions have the same time"):
        read(tmp_path, same, "rover.gpx")
    again = gpx_of([(iso(k % 30), *path_of(k)) for k in range(60)])
    with pytest.raises(ImportFileError, match="times begin again"):
        read(tmp_path, again, "rover.gpx")
    local = read(tmp_path, gpx_of([(iso(k, ""), *path_of(k)) for k in range(60)]), "rover.gpx")
    assert_whole(local)
    assert "times without a zone are UTC; --clock corrects that" in local.notes.assumed


def test_decimal_commas_of_tracks_are_not_taken_for_other_numbers(tmp_path):
    rows = [(iso(k), lat, lon, f"{alt:.2f}".replace(".", ",")) for k in range(9) for lat, lon, alt in [path_of(k)]]
    log = read(tmp_path, gpx_of(rows), "rover.gpx")
    assert np.isnan(log.places.alt_m).all() and log.notes.skipped == {"altitudes that are no numbers": 9}
    points = "".join(
        f"<Placemark><TimeStamp><when>{iso(k)}</when></TimeStamp><Point><coordinates>8,{k:07},47,0000020,430,0"
        "</coordinates></Point></Placemark>"
        for k in range(9)
    )
    with pytest.raises(ImportFileError, match="no point with a place and a time in it"):
        read(tmp_path, f"<kml><Folder>{points}</Folder></kml>", "rover.kml")
