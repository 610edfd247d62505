"""Scans in the formats of instruments, written here byte by byte: the same small map of counts in
each.
"""

import struct
import zipfile

import numpy as np
import x3pio

COUNTS = np.arange(12, dtype=np.int32).reshape(3, 4) * 7 - 30
COUNT = 2e-10  # [m]


def write_sdf(path, scale=COUNT, points=4, profiles=3):
    rows = "\n".join(" ".join(map(str, row)) for row in COUNTS)
    path.write_text(
        "aISO-1.0\nManufacID = stepblocks\nCreateDate = 010120260000\nModDate = 010120260000\n"
        f"NumPoints = {points}\nNumProfiles = {profiles}\nXscale = 1E-6\nYscale = "
        "2E-6\nZscale = "
        f"{scale}\n"
        f"Zresolution = -1\nCompression = 0\nDataType = 6\nCheckType = 0\n*\n{rows}\n*\n"
    )


def write_binary_sdf(path):
    head = struct.pack(
        "<8s10s12s12sHHddddBBB",
        b"bISO-1.0",
        b"stepblocks",
        b"0" * 12,
        b"0" * 12,
        4,
        3,
        1e-6,
        2e-6,
        COUNT,
        -1.0,
        0,
        6,
        0,
    )
    path.write_bytes(head + COUNTS.astype("<i4").tobytes())


def write_sur(path, spacing=0.2, unit=b"nm"):
    names = b"".join(
        name.ljust(16, b"\0") for name in (b"X", b"Y", b"Z", b"um", b"um", unit, b"um", b"um", unit)
    )
    head = struct.pack(
        "<12sHHHH30s30sHHHHHIIHiiiiIfff",
        b"DIGITAL SURF",
        0,
        1,
        1,
        2,
        b"block",
        b"gauge",
        0,
        0,
        1,
        0,
        1,
        0,
        0,
        32,
        int(COUNTS.min()),
        int(COUNTS.max()),
        4,
        3,
        12,
        1.0,
        2.0,
        spacing,
    )
    rest = struct.pack(
        "<fffHHHIIIHHHHHHHfIIHHH128sfff34s",
        1,
        1,
        1,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
        0,
        1,
        1,
        2026,
        0,
        0.0,
        0,
        0,
        0,
        0,
        0,
        b"",
        0,
        0,
        0,
        b"",
    )
    full = head + names + rest
    assert len(full) == 512
    path.write_bytes(full + COUNTS.astype("<i4").tobytes())


def write_ibw(path, unit=b""):
    """Write heights in micrometres as a wave of version 5 (Igor's technical note 003)."""
    heights = (np.arange(16.0) * 7 * COUNT * 1e6).astype("<f8")
    double = 4  # the type of the numbers
    wave = struct.pack("<IIIihh6xh", 0, 0, 0, heights.size, double, 0, 0)
    wave += b"wave0".ljust(40, b"\0")
    wave += struct.pack("<4i8d", 4, 4, 0, 0, 1.0, 2.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    wave += unit.ljust(4, b"\0") * 5
    wave = wave.ljust(320, b"\0")
    head = struct.pack("<hHi", 5, 0, 320 + heights.nbytes).ljust(64, b"\0")
    checksum = -int(np.frombuffer(head + wave, "<u2").sum(dtype=np.int64)) & 0xFFFF
    path.write_bytes(head[:2] + struct.pack("<H", checksum) + head[4:] + wave + heights.tobytes())


def write_x3p(path):
    x3pio.write(str(path), COUNTS * COUNT, x_scale=1e-6, y_scale=2e-6)


def write_plux(path):
    index = (
        "<xml><GENERAL><DATE>2026-01-01 "
        "00:00:00</DATE><IMAGE_SIZE_X>4</IMAGE_SIZE_X><IMAGE_SIZE_Y>3</IMAGE_SIZE_Y>"
        "<FOV_X>1</FOV_X><FOV_Y>2</FOV_Y></GENERAL>"
        "<INFO><ITEM_0><NAME>Device</NAME><VALUE>gauge</VALUE></ITEM_0></INFO>"
        "<LAYER_0><FILENAME_Z>LAYER_0.raw</FILENAME_Z></LAYER_0></xml>"
    )
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("index.xml", index)
        archive.writestr("LAYER_0.raw", (COUNTS * COUNT * 1e6).astype("<f4").tobytes())


def write_gwy(path, xy="m", z="m"):
    def item(name, kind, payload):
        return name.encode() + b"\0" + kind + payload

    def thing(name, body):
        return name.encode() + b"\0" + struct.pack("<I", len(body)) + body

    def unit(text):
        return thing("GwySIUnit", item("unitstr", b"s", text.encode() + b"\0"))

    data = (COUNTS * COUNT).astype("<f8").tobytes()
    field = (
        item("xres", b"i", struct.pack("<i", 4))
        + item("yres", b"i", struct.pack("<i", 3))
        + item("xreal", b"d", struct.pack("<d", 4e-6))
        + item("yreal", b"d", struct.pack("<d", 6e-6))
        + item("si_unit_xy", b"o", unit(xy))
        + item("si_unit_z", b"o", unit(z))
        + item("data", b"D", struct.pack("<I", 12) + data)
    )
    body = item("/0/data", b"o", thing("GwyDataField", field)) + item(
        "/0/data/title", b"s", b"Height\0"
    )
    path.write_bytes(b"GWYP" + thing("GwyContainer", body))


def write_nid(path, dim2_range=None):
    span = COUNT * 65536 if dim2_range is None else dim2_range
    channel = (
        "Version=2\r\nPoints=4\r\nLines=3\r\nFrame=Scan "
        "forward\r\nDim0Name=X*\r\nDim0Unit=m\r\nDim0Range=4e-06\r\n"
        "Dim0Min=0\r\nDim1Name=Y*\r\nDim1Unit=m\r\nDim1Range=6e-06\r\nDim1Min=0\r\n"
        "Dim2Name=Topography\r\nDim2Unit=m\r\n"
        f"Dim2Range={span!r}\r\nDim2Min={-span / 2!r}\r\nSaveMode=Binary\r\nSaveBits=16\r\n"
        "SaveSign=Signed\r\n"
        "SaveOrder=Intel\r\n"
    )
    text = (
        "[DataSet]\r\nVersion=2\r\nGroupCount=1\r\nGr0-Name=Scan "
        "forward\r\nGr0-ID=0\r\nGr0-Count=1\r\n"
        "Gr0-Ch0=DataSet-0:0\r\nSetInfos=DataSet-Info\r\nInfoSetCount=1\r\n"
        "InfoSet0=DataSetInfos\r\n\r\n"
        "[DataSet-Info]\r\n-- Scan --=--------\r\nImage "
        "size=4um\r\nDate=01-01-2026\r\nTime=00:00:00\r\n\r\n"
        f"[DataSet-0:0]\r\n{channel}"
    )
    path.write_bytes(text.encode("latin-1") + b"#!" + COUNTS.astype("<i2").tobytes())


def write_opdx(path, scale=0.2, unit="nm", map_=False):
    # as SurfaceTopography and Gwyddion's dektakvca.c read it: items of name, type, length, content;
    # containers end in 0x7F
    def text(string):
        return struct.pack("<I", len(string.encode())) + string.encode()

    def sized(raw):
        return b"\x04" + struct.pack("<I", len(raw)) + raw

    def item(name, kind, raw):
        return text(name) + bytes([kind]) + raw

    def quantity(value, symbol):
        return sized(struct.pack("<d", value) + text("unit") + text(symbol))

    def container(name, *items):
        return item(name, 0x7D, sized(b"".join(items) + text("") + b"\x7f\xff\xff"))

    def string(name, value):
        return item(name, 0x12, sized(value.encode()))

    names = sized(text("Raw"))
    if map_:
        matrix = COUNTS.astype("<f4").tobytes()
        body = container(
            "2D_Data",
            container(
                "Raw",
                string("DataKind", "Height"),
                item("Dimension1Points", 0x07, struct.pack("<I", 3)),
                item("Dimension2Points", 0x07, struct.pack("<I", 4)),
                item("Dimension1Extent", 0x13, quantity(4.0, "µm")),
                item("Dimension2Extent", 0x13, quantity(3.0, "µm")),
                item("DataScale", 0x13, quantity(scale, unit)),
                item(
                    "Matrix",
                    0x00,
                    text("")
                    + struct.pack("<I", 0)
                    + text("")
                    + sized(struct.pack("<II", 3, 4) + matrix),
                ),
            ),
        )
    else:
        row = COUNTS.ravel().astype("<f8").tobytes()
        body = container(
            "1D_Data",
            container(
                "Raw",
                string("DataKind", "Height"),
                item("NumPoints", 0x07, struct.pack("<I", 12)),
                item("Extent", 0x13, quantity(11.0, "µm")),
                item("DataScale", 0x13, quantity(scale, unit)),
                item("Array", 0x40, text("") + sized(b"\0" * 5 + row)),
            ),
        )
    kind, channels = (
        ("Surface Height", "2D_Channels") if map_ else ("Surface Profile", "1D_Channels")
    )
    listed = container(channels, item("Height", 0x42, text("") + names))
    meta = container("MetaData", string("DataKind", kind), listed)
    path.write_bytes(b"VCA DATA\x01\x00\x00\x55" + meta + body + text("") + b"\x7f\xff\xff")


WRITERS = {
    "a.sdf": write_sdf,
    "b.sdf": write_binary_sdf,
    "c.sur": write_sur,
    "d.x3p": write_x3p,
    "e.plux": write_plux,
    "f.gwy": write_gwy,
    "g.nid": write_nid,
    "h.opdx": lambda path: write_opdx(path, map_=True),
}
