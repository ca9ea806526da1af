"""Small telemetry files of every kind, as the devices write them."""

import struct
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import av
import cv2
import numpy as np

SRT = """1
00:00:00,000 --> 00:00:01,000
<font size="28">FrameCnt: 1, DiffTime: 33ms
2023-05-01 12:00:00.250
[iso: 100] [fnum: 2.8] [latitude: 47.100000] [longitude: 8.500000] \
[rel_alt: 20.500 abs_alt: 520.250] [gb_yaw: 10.0 gb_pitch: -45.5 gb_roll: 0.0] </font>

2
00:00:01,000 --> 00:00:02,000
<font size="28">FrameCnt: 2, DiffTime: 33ms
2023-05-01 12:00:01.250
[iso: 100] [fnum: 2.8] [latitude: 47.100100] [longitude: 8.500200] \
[rel_alt: 21.500 abs_alt: 521.250] [gb_yaw: 12.0 gb_pitch: -45.5 gb_roll: 0.0] </font>
"""
SRT_OLD = """1
00:00:01,000 --> 00:00:02,000
HOME(8.4990,47.0990) 2017.07.03 10:15:03
GPS(8.5000,47.1000,19) BAROMETER:20.1
ISO:100 Shutter:400 EV:-1/3 Fnum:F2.8

2
00:00:02,000 --> 00:00:03,000
HOME(8.4990,47.0990) 2017.07.03 10:15:04
GPS(8.5001,47.1001,19) BAROMETER:20.6
ISO:100 Shutter:400 EV:-1/3 Fnum:F2.8
"""
SRT_RTK = """1
00:00:00,000 --> 00:00:01,000
F/5.6, SS 400, ISO 100, EV 0, GPS (8.500000, 47.100000, 15), HOME (8.499000, 47.099000, 57.98m), \
D 698.70m, H 85.80m, H.S 5.50m/s, V.S 0.00m/s, F.PRY (2.7°, -7.0°, 110.1°), \
G.PRY (-24.4°, 0.0°, 110.4°)
"""
GPX = """<?xml version="1.0"?>
<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>
<trkpt lat="47.1" lon="8.5"><ele>520.5</ele><time>2023-05-01T12:00:00Z</time></trkpt>
<trkpt lat="47.2" lon="8.6"><ele>530.5</ele><time>2023-05-01T12:00:02.5Z</time></trkpt>
</trkseg></trk></gpx>
"""
CSV = """time,latitude,longitude,altitude_wgs84,gimbal_pitch,horizontal_accuracy
0.0,47.1,8.5,560.5,-90,0.5
0.5,47.2,8.6,561.5,-89,0.6
"""
MRK = (
    "2\t296288.242869\t[2211]\t     3,N\t     0,E\t    75,V\t47.6436873208,Lat\t16.4759271684,Lon"
    "\t512.998,Ellh\t0.03, 0.04, 0.05\t50,Q\n"
    "3\t296289.777625\t[2211]\t     5,N\t     1,E\t    75,V\t47.6436479170,Lat\t16.4758945272,Lon"
    "\t512.996,Ellh\t0.03, 0.04, 0.05\t50,Q\n"
)
GEOINFO = (
    "#Rev: sensefly/geoinfo/2\n"
    "fileName\tlatitude\tlongitude\taltitude_amsl\taltitude_wgs84\theading\tpitch\troll\n"
    "IMG_1.JPG\t37.5448\t139.0398\t216.5\t255.8\t149.4\t5.2\t3.9\t\n"
)
GEO = """EPSG:32632
DJI_0001.JPG 500000.0 5200000.0 600.5 10 20 30 0.5 1.5
DJI_0002.JPG 500010.0 5200000.0
"""
GCP = """WGS84 UTM 32N
500000.0 5200000.0 600.5 1203.5 802.25 DJI_0001.JPG corner
"""
GEOLOCATION = "a.jpg,47.1,8.5,520.5,5,10\nb.jpg,47.2,8.6,530.5,5,10\n"
TEXTS = {
    "list.csv": GEOLOCATION,
    "new.srt": SRT,
    "old.srt": SRT_OLD,
    "rtk.srt": SRT_RTK,
    "track.gpx": GPX,
    "table.csv": CSV,
    "photos.mrk": MRK,
    "geoinfo.txt": GEOINFO,
    "geo.txt": GEO,
    "gcp.txt": GCP,
}


def write_ulog(path: Path, *, in_degrees: bool = False) -> None:
    """Two fixes 0.2 s apart at 63.5 N, 10.5 E (ULog file format, version 1)."""
    unit = "double" if in_degrees else "int32_t"
    names = (
        ("latitude_deg", "longitude_deg", "altitude_msl_m", "altitude_ellipsoid_m")
        if in_degrees
        else ("lat", "lon", "alt", "alt_ellipsoid")
    )
    fields = ";".join(f"{unit} {name}" for name in names)
    gps = f"sensor_gps:uint64_t timestamp;uint64_t time_utc_usec;{fields};float eph;float epv;"
    gps += "uint8_t fix_type;"
    attitude = "vehicle_attitude:uint64_t timestamp;float[4] q;"
    messages = [_ulog("F", gps.encode()), _ulog("F", attitude.encode())]
    messages += [_ulog("A", struct.pack("<BH", 0, i) + name) for i, name in enumerate(_TOPICS)]
    for i in range(2):
        at_us, utc_us = 10_000_000 + 200_000 * i, 1_600_000_000_000_000 + 200_000 * i
        fix: Sequence[float] = (63.5 + i * 1e-5, 10.5, 60.0, 100.0)
        if not in_degrees:
            fix = [round(v * s) for v, s in zip(fix, (1e7, 1e7, 1e3, 1e3), strict=True)]
        values = struct.pack("<4d" if in_degrees else "<4i", *fix)
        body = struct.pack("<HQQ", 0, at_us, utc_us) + values + struct.pack("<ffB", 1.5, 2.5, 3)
        messages.append(_ulog("D", body))
        half = np.radians(90 / 2)
        quaternion = struct.pack("<4f", np.cos(half), 0, 0, np.sin(half))
        messages.append(_ulog("D", struct.pack("<HQ", 1, at_us) + quaternion))
    path.write_bytes(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 9_000_000) + b"".join(messages))


_TOPICS = (b"sensor_gps", b"vehicle_attitude")


def _ulog(kind: str, body: bytes) -> bytes:
    return struct.pack("<Hc", len(body), kind.encode()) + body


def write_bin(path: Path) -> None:
    """Two fixes 0.2 s apart at 35.5 S, 149.5 E, by the writer of pymavlink."""
    from pymavlink import DFReader

    reader = DFReader.DFReader_binary
    fmt = DFReader.DFFormat(0x80, "FMT", 89, "BBnNZ", "Type,Length,Name,Format,Columns")
    writer = SimpleNamespace(formats={0x80: fmt})
    kinds = {
        "GPS": (1, "QBBIHBcLLe", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt"),
        "POS": (2, "QLLff", "TimeUS,Lat,Lng,Alt,RelHomeAlt"),
        "GPA": (3, "QBCC", "TimeUS,I,HAcc,VAcc"),
        "ATT": (4, "Qccc", "TimeUS,Roll,Pitch,Yaw"),
        "MNT": (5, "QBfff", "TimeUS,I,Roll,Pitch,YawE"),
    }
    formats = {n: DFReader.DFFormat(t, n, 0, f, c) for n, (t, f, c) in kinds.items()}
    content = [reader.make_format_msgbuf(writer, f) for f in (fmt, *formats.values())]

    def write(name: str, *values: float) -> None:
        content.append(reader.make_msgbuf(writer, formats[name], values))

    for i in range(2):
        at_us = 10_000_000 + 200_000 * i
        latitude, longitude = -355_000_000 + 100 * i, 1_495_000_000
        write("GPS", at_us, 0, 3, 302_400_000 + 200 * i, 2300, 12, 80, latitude, longitude, 60_000)
        write("POS", at_us, latitude, longitude, 600.0, 20.0)
        write("GPA", at_us, 0, 150, 250)
        write("ATT", at_us, 100, -200, 27_000)
        write("MNT", at_us, 0, 0.0, -90.0, 45.0)
    path.write_bytes(b"".join(content))


def write_tlog(path: Path) -> None:
    """Two fixes 0.2 s apart at 35.5 S, 149.5 E, and one of another vehicle."""
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    half = np.radians(-60 / 2)
    down = [float(np.cos(half)), 0.0, float(np.sin(half)), 0.0]
    with path.open("wb") as file:
        for i in range(2):
            stamp = struct.pack(">Q", 1_600_000_000_000_000 + 200_000 * i)
            at_ms, latitude = 10_000 + 200 * i, -355_000_000 + 100 * i
            for system in (1, 2):
                sender = dialect.MAVLink(None, srcSystem=system)
                for message in (
                    dialect.MAVLink_global_position_int_message(
                        at_ms, latitude, 1_495_000_000 + system, 600_000, 20_000, 0, 0, 0, 9000
                    ),
                    dialect.MAVLink_gps_raw_int_message(
                        0, 3, latitude, 0, 0, 80, 80, 0, 0, 12, 0, h_acc=1500, v_acc=2500
                    ),
                    dialect.MAVLink_attitude_message(at_ms, 0.1, 0.2, 0.3, 0, 0, 0),
                    dialect.MAVLink_gimbal_device_attitude_status_message(
                        0, 0, at_ms, 16, down, 0, 0, 0, 0
                    ),
                ):
                    file.write(stamp + message.pack(sender))


def write_video(path: Path, codec: str, texts: Sequence[str]) -> None:
    """A grey video with one subtitle a second; `codec` is mov_text or subrip."""
    with av.open(str(path), "w") as container:
        video = container.add_stream("mpeg4", rate=5)
        video.width, video.height, video.pix_fmt = 64, 64, "yuv420p"
        track = container.add_mux_stream(codec)
        track.time_base = Fraction(1, 1000)
        for _ in range(5 * len(texts)):
            grey = np.full((64, 64, 3), 100, np.uint8)
            container.mux(video.encode(av.VideoFrame.from_ndarray(grey, format="rgb24")))
        for i, text in enumerate(texts):
            content = text.encode()
            if codec == "mov_text":
                content = len(content).to_bytes(2, "big") + content
            container.mux(_subtitle(track, content, 1000 * i))
        container.mux(video.encode())


def _subtitle(stream: Any, content: bytes, at_ms: int) -> av.Packet:
    packet = av.Packet(content)
    packet.stream, packet.pts, packet.dts, packet.duration = stream, at_ms, at_ms, 1000
    packet.time_base = Fraction(1, 1000)
    return packet


def write_photo(
    path: Path,
    *,
    xmp: str = "",
    gps: dict[int, Any] | None = None,
    exif: dict[int, Any] | None = None,
) -> None:
    """A small JPEG with XMP, and GPS or EXIF tags (text, byte or sequence of rationals)."""
    coded = cv2.imencode(".jpg", np.full((16, 16), 90, np.uint8))[1].tobytes()
    segments = b""
    if gps is not None:
        segments += _segment(exif_block(gps))
    if exif is not None:
        segments += _segment(b"Exif\0\0" + _tiff(exif, 0x8769))
    if xmp:
        segments += _segment(b"http://ns.adobe.com/xap/1.0/\0" + xmp.encode())
    path.write_bytes(coded[:2] + segments + coded[2:])


def exif_block(gps: dict[int, Any]) -> bytes:
    """EXIF with GPS tags alone, as stored in photos of any format."""
    return b"Exif\0\0" + _tiff(gps, 0x8825)


def _segment(content: bytes) -> bytes:
    return b"\xff\xe1" + struct.pack(">H", len(content) + 2) + content


def _tiff(gps: dict[int, Any], directory: int) -> bytes:
    start = 26
    tail_at = start + 2 + 12 * len(gps) + 4
    entries, tail = b"", b""
    for tag, value in sorted(gps.items()):
        kind, count, content = _value(value)
        placed = content.ljust(4, b"\0")
        if len(content) > 4:
            placed = struct.pack("<I", tail_at + len(tail))
            tail += content
        entries += struct.pack("<HHI", tag, kind, count) + placed
    head = b"II*\0" + struct.pack("<IHHHIII", 8, 1, directory, 4, 1, start, 0)
    return head + struct.pack("<H", len(gps)) + entries + struct.pack("<I", 0) + tail


def _value(value: Any) -> tuple[int, int, bytes]:
    if isinstance(value, str):
        return 2, len(value) + 1, value.encode() + b"\0"
    if isinstance(value, int):
        return 1, 1, bytes([value])
    ratios = [Fraction(number).limit_denominator(10_000) for number in value]
    return 5, len(ratios), b"".join(struct.pack("<II", *r.as_integer_ratio()) for r in ratios)


XMP = """<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF
 xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description rdf:about=""
 xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" drone-dji:AbsoluteAltitude="+198.31"
 drone-dji:RelativeAltitude="+39.80" drone-dji:GimbalRollDegree="+0.00"
 drone-dji:GimbalYawDegree="+45.00" drone-dji:GimbalPitchDegree="-89.90"
 drone-dji:FlightYawDegree="+46.00" drone-dji:RtkStdLat="0.03" drone-dji:RtkStdLon="0.04"
 drone-dji:RtkStdHgt="0.05"/></rdf:RDF></x:xmpmeta>"""
GPS_TAGS: dict[int, Any] = {
    1: "S",
    2: (46, 30, 36),
    3: "W",
    4: (91, 15, 18),
    5: 0,
    6: (198.25,),
    7: (12, 30, 15),
    29: "2023:05:01",
}
