"""A profile across a working edge with what was fitted to it."""

from dataclasses import dataclass

import numpy as np

from stepblocks.inspect.edge import Edge, LevelledPoints
from stepblocks.inspect.edge_flank import Flank
from stepblocks.scans.scan import ScannedProfile


@dataclass(frozen=True)
class CrossedEdge:
    """A profile across an edge, and the edge as it shows it."""

    row: ScannedProfile
    edge: Edge

    @property
    def levelled_points(self) -> LevelledPoints:
        """Points of the profile, levelled by its faces."""
        return self.edge.locate_points_beside_edge(self.row.position, self.row.height)


@dataclass(frozen=True)
class CrossedEdges:
    """Profiles across one edge that agree on it."""

    crossings: tuple[CrossedEdge, ...]
    is_map: bool  # whether they are rows of a map

    @property
    def first_crossing(self) -> CrossedEdge:
        """The first profile with its edge."""
        return self.crossings[0]

    @property
    def edges(self) -> list[Edge]:
        """The edge as each profile shows it."""
        return [crossing.edge for crossing in self.crossings]

    @property
    def spacing(self) -> float:
        """Sampling interval [m]."""
        return self.first_crossing.row.spacing

    @property
    def shows_mostly_flanks(self) -> bool:
        """Whether more than half of the profiles show a sloping flank in place of an arc."""
        return 2 * len(self.all_flanks) > len(self.crossings)

    @property
    def all_flanks(self) -> list[Flank]:
        """Flanks of the profiles that show one."""
        return [edge.flank for edge in self.edges if edge.flank is not None]

    @property
    def edge_positions(self) -> list[float]:
        """Position of the middle of the edge along each profile [m]."""
        return [edge.middle for edge in self.edges]

    def sample_evenly(self, profile_count: int) -> tuple[CrossedEdge, ...]:
        """Return about `profile_count` of the profiles, or all of fewer, evenly over a map."""
        return self.crossings[:: max(len(self.crossings) // profile_count, 1)]

    def compute_usual_height(self) -> float:
        """Return the median height of the step [m]."""
        return float(np.median([edge.height.value for edge in self.edges]))

    def compute_usual_exclusion(self) -> float:
        """Return the median half width that was kept out of the faces [m]."""
        return float(np.median([edge.exclusion for edge in self.edges]))
