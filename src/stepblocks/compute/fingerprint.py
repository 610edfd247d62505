"""What decides the bytes of a build beside its inputs: this package, libraries, the system."""

import hashlib
import platform
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import stepblocks

# Libraries whose version can change a byte that is written
_SHAPING_LIBRARIES = (
    "cadquery",
    "cadquery-ocp",
    "jinja2",
    "manifold3d",
    "matplotlib",
    "numpy",
    "plotly",
    "pyvista",
    "shapely",
    "tifffile",
    "trimesh",
    "vtk",
)
_SOURCE_ENDINGS = {".py", ".html", ".css", ".j2", ".toml"}


@dataclass(frozen=True)
class Environment:
    """With what a build was made.

    Attributes
    ----------
    python : str
        Version.
    platform : str
        System, machine and C library, whose sine has last bits of its own.
    libraries : mapping of str to str
        Version of each library that shapes the output; empty where it is missing.
    """

    python: str
    platform: str
    libraries: Mapping[str, str]

    def as_json(self) -> dict[str, object]:
        """Return it as JSON holds it."""
        return {
            "python": self.python,
            "platform": self.platform,
            "libraries": dict(self.libraries),
        }

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> "Environment":
        """Read what `as_json` gives."""
        return cls(
            content.get("python", ""), content.get("platform", ""), content.get("libraries", {})
        )


def compute_code_fingerprint() -> str:
    """Hash this package and the versions of the libraries that shape its output."""
    root = Path(stepblocks.__file__).parent
    total = hashlib.sha256()
    for path in sorted(root.rglob("*")):
        if path.suffix in _SOURCE_ENDINGS:
            name = path.relative_to(root).as_posix()
            total.update(name.encode() + b"\0" + path.read_bytes())
    for library, found in _find_library_versions().items():
        line = f"{library}=={found}\n" if found else f"{library} missing\n"
        total.update(line.encode())
    return total.hexdigest()


def _find_library_versions() -> dict[str, str]:
    """Find the version of each library, empty where it is missing."""
    versions = dict.fromkeys(_SHAPING_LIBRARIES, "")
    for library in _SHAPING_LIBRARIES:
        with suppress(PackageNotFoundError):
            versions[library] = version(library)
    return versions


def collect_environment() -> Environment:
    """Describe Python, platform, C library and libraries of this process."""
    words = [platform.system(), platform.machine(), *platform.libc_ver()]
    system = " ".join(word for word in words if word)
    return Environment(platform.python_version(), system, _find_library_versions())
