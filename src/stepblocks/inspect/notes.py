"""What an inspection says beside its values: notes, doubts, and why a value was not measured.

Each kind is a member of an enumeration whose value is its message. A note is text that knows its
kind, so that nothing has to look for words in it.
"""

from enum import Enum


class NoteKind(Enum):
    """Kinds of notes, each with its message."""

    # doubts: the scan may not show what was asked for
    PART_IN_DOUBT = (
        "{label} of {value:.4g} um is that of {twins}, declared in the same set: make sure which "
        "part was scanned"
    )
    PART_LIKELY_WRONG = (
        "{label} of {value:.4g} um is that of {twins}, declared in the same set, not its own: make "
        "sure which part was scanned"
    )
    # what was read
    HEIGHTS_READ_AS = "heights were read as: {scale}"
    RESULTS_IN_FILE = "{measured} measured in the file, {matched} of them asked for"
    NO_JUDGEMENT_IN_FILE = "the file itself passes no judgement on {keys}"
    SERIAL_NUMBER = "serial number {serial}, as the sheet states it"
    # which profiles and points were evaluated
    PROFILES_SAMPLED = "{evaluated} of {total} profiles evaluated"
    RESAMPLED = (
        "positions set to equal steps of {step:.4g} um, between which heights are interpolated"
    )
    PROFILES_REFUSED = "{refused} of {between} profiles refused, the first {reason}"
    PROFILES_BEYOND = (
        "{beyond} of {total} profiles lie beyond those that show it, the first {reason}"
    )
    SPIKES_LEFT_OUT = "{left_out} of {points} points left out as spikes"
    POINTS_LEFT_OUT = "{left_out} points missing or left out as spikes"
    # features
    OTHER_FEATURES_CROSSED = (
        "{crossing} of {total} profiles cross other features beside the {evaluated} that are "
        "evaluated"
    )
    UNLIKE_FEATURES = "{count} unlike features of {sizes} um, in this order; no mean is taken"
    FEATURES_DIFFER = (
        "the features differ by {differ:.3g} nm, so may another (standard deviation, by area)"
    )
    SINGLE_FEATURE = "one feature alone: another may be of another height"
    DOTS_KEPT = (
        "{kept} of {total} dots or craters have a level floor and lie wholly in the map, {cut} are "
        "cut by its border"
    )
    # tip
    STYLUS_TAKEN_OFF_BALL = "the stylus radius of {radius:.4g} um is taken off"
    STYLUS_OF_BALL_UNKNOWN = (
        "the radius of the stylus is not stated, so the ball may be smaller by it: state it, 0 um "
        "of an optical instrument"
    )
    FORM_OF_BALL = "form of the ball {form:.3g} um, with noise, over {angle:.3g} deg"
    # working edge
    EDGE_TURNED = "edge turned by {angle:.3g} deg; measured across it"
    SHARP_EDGE = "edge sharper than the sampling resolves; radius below {limit:.2g} um at 95 %"
    NO_ARC = "the edge is no arc: its flank slopes by {slope}, its radius is that of the corner"
    NO_ARC_OR_STEEPER = (
        "the edge is no arc: its flank slopes by {slope}, its radius is that of the corner, and "
        "the flank may be steeper: the {cone} shows none steeper"
    )
    STYLUS_TAKEN_OFF = "the stylus radius of {radius:.3g} um is taken off the edge radius"
    STYLUS_TAKEN_OFF_BOUND = (
        "the stylus radius of {radius:.3g} um is taken off the edge radius, at most this: too few "
        "points lie on the riser to tell it from the cone"
    )
    STYLUS_TOO_LARGE = (
        "the stylus radius of {radius:.3g} um is not taken off the edge radius: the edge shows "
        "{seen:.2g} um, sharper than such a stylus can; check what is stated"
    )
    WORKING_EDGE_ALONE = (
        "the working edge is the one from {begin:.4g} to {end:.4g} um, by what the declaration has "
        "beside it; left out are {beside}"
    )
    RELIEF_LEFT_OUT = (
        "the relief of {width:.3g} um at the root is none of the lower face, which is taken to go "
        "on over it as it is beside it"
    )
    ALSO_SHOWS = "the scan also shows {features}"
    ALSO_SHOWS_STEPS = (
        "the scan also shows {features}; height and radius are those of the part between such steps"
    )
    SPIKE_AT_EDGE = (
        "{spikes} single isolated point near the edge left out as spike, up to {highest:.3g} um "
        "over the face"
    )
    SPIKES_AT_EDGE = (
        "{spikes} single isolated points near the edge left out as spikes, up to {highest:.3g} um "
        "over the face"
    )
    DRIFT_OR_BEND = (
        "both faces share a form of {zone:.3g} um along the edge: drift of the instrument, or a "
        "bent part. It is taken off, so flatness and parallelism are at least what is stated; a "
        "scan of the part turned by 90 deg tells which it is"
    )
    FORM_OF_FACES = (
        "flatness and parallelism are those of the form, polynomials of degree {degree}, over what "
        "was scanned; zones of all points, noise included: {zones}"
    )
    WAVINESS_OF_FACES = (
        "flatness and parallelism hold the waviness of the faces: what a Gaussian filter "
        "(ISO 16610-61) with a cut-off of {cutoff:.3g} mm passes"
    )

    def make_note(self, **values: object) -> "Note":
        """Return the note of this kind with these values in its message."""
        return Note(self, self.value.format(**values))


class Note(str):
    """Text of a note that knows its kind.

    Attributes
    ----------
    kind : NoteKind
    """

    kind: NoteKind

    def __new__(cls, kind: NoteKind, message: str) -> "Note":
        """Make a note from its kind and its filled message."""
        note = super().__new__(cls, message)
        note.kind = kind
        return note

    def prefix_source(self, source: str) -> "Note":
        """Return the note behind the name of what it is of."""
        return Note(self.kind, f"{source}: {self}")

    def __getnewargs__(self) -> tuple[NoteKind, str]:  # type: ignore[override]  # for pickle
        return self.kind, str(self)


class NotMeasuredReason(Enum):
    """Why a scan does not measure a characteristic, each with its message."""

    UPRIGHT_RISER = (
        "the riser is upright as far as it is seen from above; a section or replica across the "
        "edge would show it"
    )
    STYLUS_CONE = (
        "the {cone} shows no riser steeper than {slope}; a section or replica across the edge "
        "would show it"
    )
    VALLEY_AT_FOOT = (
        "the lower face falls at the foot of the edge, as it does where heights are upside down; "
        "make sure of their sign"
    )
    RELIEF_NOT_SEEN = (
        "the scan shows no relief of about the declared width and depth at the root of the riser"
    )
    WALLS_OF_RELIEF = (
        "a stylus draws riser and wall as flanks of its own: state 0 um and 0 deg of an optical "
        "instrument, or use a microscope"
    )
    GAP_UNDER_BEVEL = (
        "a trace shows the opening of the margin; a section or replica would show the gap beneath"
    )
    PARALLEL_OVER_TWO_STEPS = (
        "a trace over two edges levels each of them for itself; interferometer or comparator over "
        "A, the lower face"
    )
    UPPER_FACE_TOO_SHORT = (
        "a scan that reaches 0.2 mm beyond the edge on the upper face would show it"
    )
    PART_OF_FACE = (
        "scanned {scanned} mm of {face} mm; a map of {least:.0%} of either side, or {method}"
    )

    def format_message(self, **values: object) -> str:
        """Return the message of this reason with these values."""
        return str(self.value).format(**values)
