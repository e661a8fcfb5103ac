#!/usr/bin/env python3
"""Writes a DICOM segmentation (BINARY, one segment: a bent plate) with nothing but Python's standard library.

For trying the recipe without a patient. Equal arguments give equal bytes, another name another patient and study,
another number another instance of the same series.

usage: make_seg.py NAME OUT.dcm [--number N] [--spacing MM] [--manufacturer NAME] [--implicit]
"""

import argparse
import hashlib
import math
import struct

SEGMENTATION = "1.2.840.10008.5.1.4.1.1.66.4"
MR_IMAGE = "1.2.840.10008.5.1.4.1.1.4"
EXPLICIT, IMPLICIT = "1.2.840.10008.1.2.1", "1.2.840.10008.1.2"
# Width, height and depth of the volume in mm; the plate fills most of it.
SIZE_MM = (64.0, 48.0, 32.0)
THICKNESS_MM = 8.0
LONG_KINDS = ("OB", "OW", "SQ", "UN", "UT")


class Writer:
    """Elements as bytes, little endian."""

    def __init__(self, explicit):
        self.explicit = explicit

    def element(self, tag, kind, value):
        body = self.value(kind, value)
        if len(body) % 2:
            body += b"\0" if kind in ("UI", "OB") else b" "
        head = struct.pack("<HH", tag >> 16, tag & 0xFFFF)
        if not self.explicit:
            return head + struct.pack("<I", len(body)) + body
        if kind in LONG_KINDS:
            return head + kind.encode() + struct.pack("<HI", 0, len(body)) + body
        return head + kind.encode() + struct.pack("<H", len(body)) + body

    def value(self, kind, value):
        if kind == "SQ":
            return b"".join(self.item(item) for item in value)
        if kind == "US":
            return struct.pack("<%dH" % len(value), *value)
        if kind == "UL":
            return struct.pack("<%dI" % len(value), *value)
        if kind == "AT":
            return b"".join(struct.pack("<HH", tag >> 16, tag & 0xFFFF) for tag in value)
        return value if isinstance(value, bytes) else value.encode("ascii")

    def item(self, elements):
        body = self.elements(elements)
        return struct.pack("<HHI", 0xFFFE, 0xE000, len(body)) + body

    def elements(self, elements):
        return b"".join(self.element(*element) for element in sorted(elements))


def uid(name, what):
    """2.25 and 128 bits that follow from the name."""
    return "2.25." + str(int.from_bytes(hashlib.sha256(f"{name} {what}".encode()).digest()[:16], "big"))


def code(value, scheme, meaning):
    return [(0x00080100, "SH", value), (0x00080102, "SH", scheme), (0x00080104, "LO", meaning)]


def decimals(*numbers):
    return "\\".join("%.6g" % number for number in numbers)


def is_inside(x, y, z):
    """A plate bent about the y axis, all in mm from the middle of the volume."""
    return abs(x) < 26 and abs(y) < 18 and abs(z - 6 * math.cos(x / 20)) < THICKNESS_MM / 2


def slices(spacing):
    """Number of slice and its bits, row by row, for each slice that holds something; rows, columns."""
    columns, rows, depth = (round(size / spacing) for size in SIZE_MM)
    found = []
    for k in range(depth):
        z = (k + 0.5) * spacing - SIZE_MM[2] / 2
        line = [is_inside((i + 0.5) * spacing - SIZE_MM[0] / 2, 0, z) for i in range(columns)]
        bits = []
        for j in range(rows):
            is_in_height = abs((j + 0.5) * spacing - SIZE_MM[1] / 2) < 18
            bits += line if is_in_height else [False] * columns
        if any(bits):
            found.append((k, bits))
    return found, rows, columns


def packed(bits):
    """One bit a voxel, the first one lowest; bits run on over frames."""
    bits = bits + [False] * (-len(bits) % 8)
    return bytes(sum(bit << place for place, bit in enumerate(bits[at : at + 8])) for at in range(0, len(bits), 8))


def instance_uid(name, number):
    return uid(name, f"instance {number}")


def identity(name, number, manufacturer):
    return [
        (0x00080005, "CS", "ISO_IR 100"),
        (0x00080008, "CS", "DERIVED\\PRIMARY"),
        (0x00080016, "UI", SEGMENTATION),
        (0x00080018, "UI", instance_uid(name, number)),
        (0x00080020, "DA", "20260102"),
        (0x00080021, "DA", "20260102"),
        (0x00080023, "DA", "20260102"),
        (0x00080030, "TM", "030405"),
        (0x00080031, "TM", "030405"),
        (0x00080033, "TM", "030405"),
        (0x00080050, "SH", ""),
        (0x00080060, "CS", "SEG"),
        (0x00080070, "LO", manufacturer),
        (0x00080090, "PN", ""),
        (0x00081090, "LO", "make_seg.py"),
        (0x00100010, "PN", "RECIPE^" + name.upper()),
        (0x00100020, "LO", "RECIPE-" + name.upper()),
        (0x00100030, "DA", ""),
        (0x00100040, "CS", ""),
        (0x00181000, "LO", "1"),
        (0x00181020, "LO", "1"),
        (0x0020000D, "UI", uid(name, "study")),
        (0x0020000E, "UI", uid(name, "series")),
        (0x00200010, "SH", ""),
        (0x00200011, "IS", "2"),
        (0x00200013, "IS", str(number)),
        (0x00200052, "UI", uid(name, "frame of reference")),
        (0x00201040, "LO", ""),
    ]


def segment():
    return [
        (0x00620003, "SQ", [code("91723000", "SCT", "Anatomical structure")]),
        (0x00620004, "US", [1]),
        (0x00620005, "LO", "Plate"),
        (0x00620008, "CS", "MANUAL"),
        (0x0062000F, "SQ", [code("10200004", "SCT", "Liver")]),
    ]


def shared(spacing):
    derivation = code("113076", "DCM", "Segmentation")
    purpose = code("121322", "DCM", "Source image for image processing operation")
    source = [
        (0x00081150, "UI", MR_IMAGE),
        (0x00081155, "UI", uid("any", "source")),
        (0x0040A170, "SQ", [purpose]),
    ]
    return [
        (0x00089124, "SQ", [[(0x00082112, "SQ", [source]), (0x00089215, "SQ", [derivation])]]),
        (0x00209116, "SQ", [[(0x00200037, "DS", decimals(1, 0, 0, 0, 1, 0))]]),
        (
            0x00289110,
            "SQ",
            [
                [
                    (0x00180050, "DS", decimals(spacing)),
                    (0x00180088, "DS", decimals(spacing)),
                    (0x00280030, "DS", decimals(spacing, spacing)),
                ]
            ],
        ),
        (0x0062000A, "SQ", [[(0x0062000B, "US", [1])]]),
    ]


def frame(place, k, spacing):
    position = decimals(*((0.5 * spacing - size / 2) for size in SIZE_MM[:2]), (k + 0.5) * spacing - SIZE_MM[2] / 2)
    return [
        (0x00209111, "SQ", [[(0x00209157, "UL", [1, place + 1])]]),
        (0x00209113, "SQ", [[(0x00200032, "DS", position)]]),
    ]


def dimensions(name):
    organization = uid(name, "dimensions")

    def index(pointer, group):
        return [
            (0x00209164, "UI", organization),
            (0x00209165, "AT", [pointer]),
            (0x00209167, "AT", [group]),
        ]

    return [
        (0x00209221, "SQ", [[(0x00209164, "UI", organization)]]),
        (0x00209222, "SQ", [index(0x0062000B, 0x0062000A), index(0x00200032, 0x00209113)]),
    ]


def content(name, number, spacing, manufacturer):
    found, rows, columns = slices(spacing)
    bits = [bit for _, frame_bits in found for bit in frame_bits]
    reference = [(0x00081150, "UI", MR_IMAGE), (0x00081155, "UI", uid("any", "source"))]
    series = [(0x0008114A, "SQ", [reference]), (0x0020000E, "UI", uid("any", "source series"))]
    return (
        identity(name, number, manufacturer)
        + dimensions(name)
        + [
            (0x00081115, "SQ", [series]),
            (0x00280002, "US", [1]),
            (0x00280004, "CS", "MONOCHROME2"),
            (0x00280008, "IS", str(len(found))),
            (0x00280010, "US", [rows]),
            (0x00280011, "US", [columns]),
            (0x00280100, "US", [1]),
            (0x00280101, "US", [1]),
            (0x00280102, "US", [0]),
            (0x00280103, "US", [0]),
            (0x00282110, "CS", "00"),
            (0x00620001, "CS", "BINARY"),
            (0x00620002, "SQ", [segment()]),
            (0x00700080, "CS", "PLATE"),
            (0x00700081, "LO", "A bent plate"),
            (0x00700084, "PN", ""),
            (0x52009229, "SQ", [shared(spacing)]),
            (0x52009230, "SQ", [frame(place, k, spacing) for place, (k, _) in enumerate(found)]),
            (0x7FE00010, "OB", packed(bits)),
        ]
    )


def file_bytes(name, number=1, spacing=2.0, manufacturer="recipe", transfer=EXPLICIT):
    """The whole file; edge of a voxel in mm."""
    meta = Writer(True).elements(
        [
            (0x00020001, "OB", b"\0\1"),
            (0x00020002, "UI", SEGMENTATION),
            (0x00020003, "UI", instance_uid(name, number)),
            (0x00020010, "UI", transfer),
            (0x00020012, "UI", "2.25.1"),
        ]
    )
    length = Writer(True).element(0x00020000, "UL", [len(meta)])
    body = Writer(transfer == EXPLICIT).elements(content(name, number, spacing, manufacturer))
    return bytes(128) + b"DICM" + length + meta + body


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("name", help="letters and digits: patient, study and instance follow from it")
    parser.add_argument("out", help="the file to write")
    parser.add_argument("--number", type=int, default=1, help="of the instance in its series")
    parser.add_argument("--spacing", type=float, default=2.0, help="edge of a voxel in mm; smaller takes longer (2)")
    parser.add_argument("--manufacturer", default="recipe")
    parser.add_argument("--implicit", action="store_true", help="implicit little endian in place of explicit")
    given = parser.parse_args()
    transfer = IMPLICIT if given.implicit else EXPLICIT
    with open(given.out, "wb") as file:
        file.write(file_bytes(given.name, given.number, given.spacing, given.manufacturer, transfer))


if __name__ == "__main__":
    main()
