"""Number of values in a Protobuf message, counted before it is parsed (protobuf.dev/programming-guides/encoding).

A parser makes an object of a hundred bytes of each part, which can take two bytes of the message.
"""

from __future__ import annotations

from typing import Any

from semcal_cli.config.file_limits import MAX_PROTOBUF_VALUES
from semcal_cli.importing.bags.messages import MessageError

VARINT, FIXED_64, LENGTH, FIXED_32 = 0, 1, 2, 5
"""Wire types; the others are groups, which Foxglove's schemas do not have."""
SIZES = {FIXED_64: 8, FIXED_32: 4}
STRING, BYTES, MESSAGE = 9, 12, 11
"""Types of fields in a descriptor (descriptor.proto, FieldDescriptorProto.Type)."""


def check_values(raw: bytes, descriptor: Any) -> None:
    """Check that a message and those in it have few values.

    Args:
        raw: The message.
        descriptor: Its descriptor.

    Raises:
        MessageError: there are more than `MAX_PROTOBUF_VALUES`, or the bytes are not a message.
    """
    num_values, parts = 0, [(0, len(raw), descriptor)]
    while parts:
        place, end, kind = parts.pop()
        while place < end:
            num_values += 1
            key, place = _varint(raw, place)
            field, wire = None if kind is None else kind.fields_by_number.get(key >> 3), key & 7
            size = SIZES.get(wire, 0)
            if wire == VARINT:
                _, place = _varint(raw, place)
            elif wire == LENGTH:
                size, place = _varint(raw, place)
                if field is not None and field.type == MESSAGE:
                    parts.append((place, place + size, field.message_type))
                elif field is not None and field.type not in (STRING, BYTES):
                    num_values += size  # numbers in a row, each of one byte or more
            elif wire not in SIZES:
                raise MessageError(
                    f"found a group or the wire type {wire} in a Protobuf message, expected values"
                )
            place += size
            if place > end:
                raise MessageError("found a value that goes beyond its Protobuf message")
            if num_values > MAX_PROTOBUF_VALUES:
                needed = f"needed at most {MAX_PROTOBUF_VALUES:,}"
                raise MessageError(
                    f"found a Protobuf message of more than {MAX_PROTOBUF_VALUES:,} values, {needed}"
                )


def _varint(raw: bytes, place: int) -> tuple[int, int]:
    """Read a whole number of up to ten bytes; return it and the place after it."""
    number = 0
    for index, byte in enumerate(raw[place : place + 10]):
        number |= (byte & 0x7F) << (7 * index)
        if byte < 0x80:
            return number, place + index + 1
    raise MessageError("found a number that does not end in a Protobuf message")
