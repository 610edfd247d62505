"""The formats of scans; what stands in `READERS` is read."""

from stepblocks.scans.formats.digital_surf import DigitalSurfReader
from stepblocks.scans.formats.gwyddion import GwyddionReader
from stepblocks.scans.formats.heightfield import HeightFieldReader, TiffReader
from stepblocks.scans.formats.nanofocus import NanoFocusReader
from stepblocks.scans.formats.points import PointReader
from stepblocks.scans.formats.reader import ScanReader
from stepblocks.scans.formats.sdf import SdfReader
from stepblocks.scans.formats.surface_topography import SurfaceTopographyReader, TextMatrixReader
from stepblocks.scans.formats.text import TextReader
from stepblocks.scans.formats.truemap import TrueMapReader
from stepblocks.scans.formats.x3p import X3pReader

# In the order in which readers with the same ending are asked
READERS: tuple[ScanReader, ...] = (
    TextMatrixReader(),
    TextReader(),
    HeightFieldReader(),
    PointReader(),
    TiffReader(),
    X3pReader(),
    SdfReader(),
    DigitalSurfReader(),
    SurfaceTopographyReader("plux", (".plux",)),
    GwyddionReader(),
    SurfaceTopographyReader("opdx", (".opdx",)),
    SurfaceTopographyReader("ezd", (".nid", ".ezd")),
    SurfaceTopographyReader("opd", (".opd",)),
    SurfaceTopographyReader("datx", (".datx",)),
    SurfaceTopographyReader("al3d", (".al3d",)),
    SurfaceTopographyReader("plu", (".plu",)),
    SurfaceTopographyReader("zon", (".zon",)),
    SurfaceTopographyReader("vk", (".vk4",)),
    SurfaceTopographyReader("ibw", (".ibw",)),
    SurfaceTopographyReader("mi", (".mi",)),
    SurfaceTopographyReader("mnt", (".mnt",)),
    TrueMapReader(),
    NanoFocusReader(),
    SurfaceTopographyReader("wsxm", (".stp", ".top")),
    SurfaceTopographyReader("frt", (".frt",)),
    SurfaceTopographyReader("di", (".spm", ".di"), (b"\\*Fi",)),
    SurfaceTopographyReader("metropro", (), (b"\x88\x1b\x03\x6f", b"\x88\x1b\x03\x70")),
)
