"""Sweeps of recordings as binary PCD, with all their fields.

Numbers stay as they are, except times whose unit no reader could know: these become seconds, see
`_with_readable_times`.
"""

from __future__ import annotations

import atexit
import os
import re
import struct
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from semcal_cli.config import MAX_POINTS
from semcal_cli.config.file_limits import MAX_FIELDS
from semcal_cli.config.nanoseconds import NS
from semcal_cli.config.point_files import NamedUnit
from semcal_cli.drive.lidar import Lidar
from semcal_cli.errors import counted, listed
from semcal_cli.geometry.arrays import Array, Mask, Numbers, Points
from semcal_cli.importing.bags.messages import CLOUD, HEADER_BYTES, VELODYNE, Message, MessageError
from semcal_cli.observations.point_times import length_of_unit

POINT_FIELD_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""NumPy's name of each datatype of a sensor_msgs/PointField."""
MAX_POINT_BYTES = 1024
PACKET_POINTS = 384
"""Largest number of points in a packet of a Velodyne: 12 blocks of 32."""
LIVOX_POINT = [
    ("offset_time", "u4"), ("x", "f4"), ("y", "f4"), ("z", "f4"), ("reflectivity", "u1"), ("tag", "u1"), ("line", "u1"),
]  # fmt: skip
"""CustomPoint.msg of both of Livox' drivers."""
TIMES = ("t", "time", "timestamp", "offset_time", "time_offset", "time_stamp", "timestamps", "gps_time")
"""Names of fields of times, the preferred ones first."""
READ_AS_TIME = ("t", "time", "timestamp", "offset_time", "time_offset", "gps_time")
"""Those of them that the reader of point clouds knows."""
TICKS_S = {"nanoseconds": 1e-9, "microseconds": 1e-6, "milliseconds": 1e-3, "seconds": 1.0}
CDR_BYTES = 4
"""Bytes of CDR's encapsulation header; alignment is relative to its end."""
SHORTEST_SWEEP_S, LONGEST_SWEEP_S = 0.004, 1.5
"""Times that the points of a sweep can span. Units differ by a factor of a thousand, so at most one of them fits."""


class PointTimes(NamedTuple):
    """What the times of a sweep's points refer to."""

    reference: str | None = None
    """`relative` or `absolute`, as a drive's motion states it; None without times on the clock of the header."""
    ends_s: tuple[float, float] = (0.0, 0.0)
    """Times of the first and the last point with a range, seconds after the stamp."""
    remark: str | None = None
    """Sentence about them that the user should read."""
    unit: NamedUnit = "s"
    """Their unit in the file that is written."""


class Sweep(NamedTuple):
    """A sweep of a recording."""

    records: npt.NDArray[np.void]
    """(height, width) records of all fields, little endian and without gaps."""
    times: PointTimes
    """Times of its points."""
    seconds: Numbers | None = None
    """(height, width) times of its points after the stamp; None without times on the clock of the header. Those by the
    spin of the LiDAR are in no field."""

    @property
    def points(self) -> Points:
        """Points (N, 3), metres."""
        return np.stack([self.records[axis].astype(np.float32).ravel() for axis in "xyz"], axis=1)

    def pcd(self) -> bytes:
        """Make the content of a binary PCD 0.7."""
        height, width = self.records.shape
        layout = self.records.dtype
        fields = {name: layout[name] for name in layout.names or ()}
        header = {
            "VERSION": ["0.7"],
            "FIELDS": fields,
            "SIZE": [field_type.base.itemsize for field_type in fields.values()],
            "TYPE": [field_type.base.kind.upper() for field_type in fields.values()],
            "COUNT": [_count(field_type) for field_type in fields.values()],
            "WIDTH": [width],
            "HEIGHT": [height],
            "VIEWPOINT": [0, 0, 0, 1, 0, 0, 0],
            "POINTS": [width * height],
            "DATA": ["binary"],
        }
        lines = [f"{key} {' '.join(map(str, values))}" for key, values in header.items()]
        text = "\n".join(["# .PCD v0.7 - Point Cloud Data file format", *lines])
        return text.encode() + b"\n" + self.records.tobytes()


def read_sweep(message: Message, stamp_ns: int, lidar: Lidar | None = None) -> Sweep:
    """Read a PointCloud2, a Livox CustomMsg or a VelodyneScan.

    Args:
        message: The message.
        stamp_ns: Time of the sweep, which its points' times refer to.
        lidar: How the LiDAR turns, which gives the times of points that have none, where its rays start, and which
            points are its own.

    Raises:
        MessageError: the message is damaged, contradicts itself or has no point with a range, or none of the LiDAR's
            own.
    """
    if message.is_a(VELODYNE):
        records = _velodyne(message, stamp_ns)
    else:
        records = _point_cloud2(message) if message.is_a(CLOUD) else _livox(message)
    names = records.dtype.names or ()
    if not {"x", "y", "z"} <= set(names):
        raise MessageError(f"found the fields {listed(names)}, expected x, y and z")
    if axes := [axis for axis in "xyz" if _count(records.dtype[axis]) > 1]:
        raise MessageError(f"found several numbers in field {axes[0]!r}, expected one")
    has_range = _has_range(records)
    if not has_range.any():
        raise MessageError(f"found {counted(records.size, 'point')}, none with a range")
    if lidar is not None and lidar.own_values is not None:
        _check_own(records[has_range], *lidar.own_values)
    rate_hz = message.topic.rate_hz
    sweep = _with_readable_times(records, has_range, stamp_ns, 1.0 / rate_hz if rate_hz else None)
    if lidar is None or lidar.spin is None or sweep.times.reference is not None:
        return sweep
    seconds = lidar.spin.times(lidar.rays(sweep.points)).reshape(records.shape)
    times = PointTimes("relative", _ends(seconds[has_range]))
    if (name := _time_field(records)) is None:
        return sweep._replace(times=times, seconds=seconds)
    remark = f"the point times {name!r} do not tell the time: those by --spin are written as 't' instead"
    return Sweep(_with_times(records, name, seconds), times._replace(remark=remark), seconds)


def _check_own(records: npt.NDArray[np.void], field: str, ends: tuple[float, float]) -> None:
    """Refuse a sweep without the field that tells the LiDAR's own points, or without such points."""
    names = records.dtype.names or ()
    name = next((name for name in names if name.lower() == field.lower()), None)
    if name is None or _count(records.dtype[name]) > 1:
        raise MessageError(f"--own-points: found the fields {listed(names)}, expected {field!r} among them")
    values, (first, last) = records[name], ends
    if not ((values >= first) & (values <= last)).any():
        found = f"{name!r} from {values.min():g} to {values.max():g}"
        raise MessageError(f"--own-points: found {found}, expected points from {first:g} to {last:g}")


def _count(field: np.dtype[Any]) -> int:
    """Count the numbers of a field in one record."""
    return int(np.prod(field.shape, dtype=int))


def _has_range(records: npt.NDArray[np.void]) -> Mask:
    """Return whether each point (height, width) is finite and not at the sensor."""
    axes = np.stack([records[axis].astype(np.float32) for axis in "xyz"])
    with np.errstate(invalid="ignore"):
        has_range: Mask = np.isfinite(axes).all(axis=0) & (axes != 0.0).any(axis=0)
    return has_range


def _point_cloud2(message: Message) -> npt.NDArray[np.void]:
    """Read the points of a PointCloud2 of any layout, in either byte order."""
    cloud = message.content
    width, height, step, row = int(cloud.width), int(cloud.height), int(cloud.point_step), int(cloud.row_step)
    if width * height == 0:
        raise MessageError("found a cloud without points")
    if width * height > MAX_POINTS:
        raise MessageError(f"found {width * height:,} points, needed at most {MAX_POINTS:,}")
    layout = _layout(cloud, step)
    row = width * step if height == 1 else row
    if row < width * step:
        raise MessageError(f"found row_step {row:,}, needed {width * step:,} or more for {width:,} points")
    needed = (height - 1) * row + width * step
    if len(cloud.data) < needed:
        raise MessageError(f"found {counted(len(cloud.data), 'byte')} of points, needed {needed:,}")
    points: npt.NDArray[np.void] = np.ndarray((height, width), layout, cloud.data.tobytes(), 0, (row, step))
    return points.astype([(name, layout[name].newbyteorder("<")) for name in layout.names or ()])


def _layout(cloud: Any, step: int) -> np.dtype[Any]:
    """Make the layout of a point's record."""
    if not 0 < step <= MAX_POINT_BYTES or len(cloud.fields) > MAX_FIELDS:
        description = f"point_step {step:,} and {len(cloud.fields):,} fields"
        raise MessageError(
            f"found {description}, needed at most {MAX_POINT_BYTES:,} bytes and {MAX_FIELDS} fields"
        )
    order = ">" if cloud.is_bigendian else "<"
    names, formats, offsets = [], [], []
    for field in cloud.fields:
        kind, count = POINT_FIELD_TYPES.get(int(field.datatype)), max(int(field.count), 1)
        if kind is None:
            raise MessageError(f"found field {field.name!r} of datatype {field.datatype}, needed 1 to 8")
        end = int(field.offset) + np.dtype(kind).itemsize * count
        if end > step:
            raise MessageError(f"found field {field.name!r} up to byte {end:,}, beyond point_step {step:,}")
        names.append(re.sub(r"\s+", "_", field.name.strip("\0")) or "_")
        formats.append((order + kind, (count,)) if count > 1 else order + kind)
        offsets.append(int(field.offset))
    if len(set(names)) < len(names):
        raise MessageError(f"found a field twice in {listed(names)}")
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": step})


def _livox(message: Message) -> npt.NDArray[np.void]:
    """Read the points of a CustomMsg directly from its bytes: a general reader would make an object of each point.

    The header is followed by `timebase` (8 bytes), `point_num`, `lidar_id` with three reserved bytes, and the points,
    preceded by their number. CDR aligns each of these, and each point, to the size of its numbers.
    """
    order, raw = message.byte_order, message.raw
    layout = np.dtype([(name, order + kind) for name, kind in LIVOX_POINT], align=not message.topic.is_ros1)
    packed = np.dtype([(name, f"<{kind}") for name, kind in LIVOX_POINT])
    offset = HEADER_BYTES + (
        struct.unpack_from(f"{order}I", raw, HEADER_BYTES - 4)[0] if len(raw) >= 16 else 0
    )
    if not message.topic.is_ros1:
        offset += (CDR_BYTES - offset) % 8
    offset += 8 + 4 + 4  # timebase, point_num, and lidar_id with its reserved bytes
    if offset + 4 > len(raw):
        raise MessageError(
            f"found {counted(len(raw), 'byte')} of something else, expected a {message.topic.type}"
        )
    (count,) = struct.unpack_from(f"{order}I", raw, offset)
    if count == 0:
        raise MessageError("found a cloud without points")
    # The last point has no padding after it.
    if count > MAX_POINTS or offset + 4 + (count - 1) * layout.itemsize + packed.itemsize > len(raw):
        raise MessageError(f"found {counted(count, 'point')} in {counted(len(raw), 'byte')}")
    padded = raw[offset + 4 :] + bytes(layout.itemsize - packed.itemsize)
    return np.frombuffer(padded, layout, count).astype(packed).reshape(1, count)


@cache
def _velodyne_decoder() -> Any:
    """Import the library, and hide the leaks that its bindings report on standard error when the process ends."""
    import velodyne_decoder

    atexit.register(lambda: os.dup2(os.open(os.devnull, os.O_WRONLY), 2))
    return velodyne_decoder


def _velodyne(message: Message, stamp_ns: int) -> npt.NDArray[np.void]:
    """Decode the packets of a VelodyneScan; the times of points become seconds after the stamp of the sweep."""
    velodyne_decoder, scan = _velodyne_decoder(), message.content
    if not scan.packets:
        raise MessageError("found a cloud without points")
    if len(scan.packets) * PACKET_POINTS > MAX_POINTS:
        problem = f"found {counted(len(scan.packets), 'packet')}"
        raise MessageError(f"{problem}, needed at most {MAX_POINTS // PACKET_POINTS:,}")
    stamps_ns = [packet.stamp.sec * NS + packet.stamp.nanosec for packet in scan.packets]
    # The library does not accept negative times.
    begin_ns = min(stamps_ns) - NS
    stamps_s = [(packet_ns - begin_ns) / NS for packet_ns in stamps_ns]
    packets = velodyne_decoder.PacketVector()
    for stamp_s, packet in zip(stamps_s, scan.packets, strict=True):
        packets.append(velodyne_decoder.VelodynePacket(stamp_s, packet.data.tobytes()))
    try:
        decoder = velodyne_decoder.ScanDecoder(velodyne_decoder.Config())
        stamp, points = decoder.decode(packets, as_pcl_structs=True)
    except Exception as error:  # Hostile bytes raise errors of several kinds in the library.
        raise MessageError(
            f"found {counted(len(scan.packets), 'packet')} that cannot be decoded: {error}"
        ) from None
    points["time"] += np.float32(stamp.host + (begin_ns - stamp_ns) / NS)
    layout: np.dtype[Any] = points.dtype
    packed: npt.NDArray[np.void] = points.astype([(name, layout[name]) for name in layout.names or ()])
    return packed.reshape(1, -1)


def _with_readable_times(
    records: npt.NDArray[np.void], has_range: Mask, stamp_ns: int, gap_s: float | None
) -> Sweep:
    """Find out what the times of points refer to, and convert them if no reader could read them.

    Readers take whole numbers for nanoseconds and others for seconds. Times in another unit, shares of a turn among
    them, or under a name that no reader knows, become seconds relative to the stamp, as float64, under the name `t`.
    Points without a range often have no time either and are ignored.
    """
    name = _time_field(records)
    if name is None:
        return Sweep(records, PointTimes())
    time_fields = [field for field in records.dtype.names or () if field.lower() in (name.lower(), "t")]
    if len(time_fields) > 1:
        raise MessageError(
            f"found the fields {listed(time_fields)}, any of which may hold the times, expected only one"
        )
    values = records[name]
    first, last = _ends(values[has_range])
    spans = [
        unit for unit, tick in TICKS_S.items() if SHORTEST_SWEEP_S <= (last - first) * tick <= LONGEST_SWEEP_S
    ]
    subject = f"the point times {name!r}"
    if not spans:
        remark = (
            f"{subject} do not span a sweep in any usual unit: they are written unchanged, without motion"
        )
        return Sweep(records, PointTimes(remark=remark))
    unit, tick_s = spans[0], TICKS_S[spans[0]]
    length_s = length_of_unit(first, last, tick_s, gap_s)
    if length_s is None:
        apart = "" if gap_s is None else f", and sweeps are {gap_s:.3g} s apart"
        remark = (
            f"{subject} span {(last - first) * tick_s:.3g} s as {unit}{apart}: they are written unchanged, without "
            "motion; time_unit in drive.yaml states their unit"
        )
        return Sweep(records, PointTimes(remark=remark))
    if length_s != tick_s:
        unit, tick_s = f"shares of a turn of {length_s:g} s", length_s
    shift = _shift(first, tick_s, stamp_ns)
    if shift is None:
        remark = f"{subject} use another clock than the header: they are written unchanged, without motion"
        return Sweep(records, PointTimes(remark=remark))
    # Whole numbers are subtracted as such: as float64, nanoseconds since 1970 would lose their last 8 bits.
    exact = values.astype(np.int64) if values.dtype.kind in "iu" else values
    seconds = (exact - shift).astype(np.float64) * tick_s
    ends_s = _ends(seconds[has_range])
    if name.lower() in READ_AS_TIME and tick_s == (1.0 if values.dtype.kind == "f" else 1e-9):
        unit_in_file: NamedUnit = "s" if values.dtype.kind == "f" else "ns"
        reference = "absolute" if shift else "relative"
        return Sweep(records, PointTimes(reference, ends_s, unit=unit_in_file), seconds)
    remark = f"{subject}, {unit}, are written as 't', seconds after the sweep's stamp"
    return Sweep(_with_times(records, name, seconds), PointTimes("relative", ends_s, remark), seconds)


def _time_field(records: npt.NDArray[np.void]) -> str | None:
    """Name the field of the times; None without one."""
    name_by_lower = {name.lower(): name for name in reversed(records.dtype.names or ())}
    name = next((name_by_lower[key] for key in TIMES if key in name_by_lower), None)
    return None if name is None or _count(records.dtype[name]) > 1 else name


def _ends(values: Array) -> tuple[float, float]:
    """Find the first and the last finite time; zeros without one."""
    finite = values[np.isfinite(values)] if values.dtype.kind == "f" else values
    return (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)


def _shift(first: float, tick_s: float, stamp_ns: int) -> int | None:
    """Find what to subtract from times to make them relative, in their own unit; None if they are on another clock."""
    stamp = round(stamp_ns / (tick_s * NS))
    shifts = [shift for shift in (0, stamp) if abs(first - shift) * tick_s <= LONGEST_SWEEP_S]
    return shifts[0] if shifts else None


def _with_times(records: npt.NDArray[np.void], name: str, seconds: Numbers) -> npt.NDArray[np.void]:
    """Replace a field by times in seconds, under the preferred name."""
    layout = records.dtype
    changed = records.astype(
        [("t", "<f8") if field == name else (field, layout[field]) for field in layout.names or ()]
    )
    changed["t"] = seconds
    return changed
