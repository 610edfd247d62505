"""Every text of the window: a translation is this one file.

Names in braces are filled in. Messages about a user's files are those of the command line.
"""

TITLE = "stepblocks"
SKIP_TO_CONTENT = "Skip to the content"
NAVIGATION = "Pages"
START = "Start"
COLOURS = "Light, dark, or as the system"
INTERNAL_ERROR = "An internal error, not a verdict: the terminal of the window says more"

REFUSED_HOST = "only this machine may ask this"
REFUSED_TOKEN = "open the address that the terminal shows: it carries the token of this window"
REFUSED_LENGTH = "a request must say its length"
REFUSED_SIZE = "a request must have at most {most} bytes"
NO_FILE = "there is no such file in the folder of this window"

FOLDER = "Folder {path}; every command below is run there"
EMPTY_FOLDER = (
    "Nothing here yet that a command takes: no stimulus file, scan, session, study or output. "
    "Begin with one of these:"
)
REFRESH = "Look again"
STIMULI = "Stimulus files"
SCANS = "Scans and tables"
SESSIONS = "Bench sessions"
STUDIES = "Studies"
OUTPUTS = "Outputs of builds"
COUNT = "{title} ({count})"

COPY_COMMAND = "Copy as command"
COPY_PYTHON = "Copy as Python"
COPIED = "Copied"
COMMAND_OF = "Command: {title}"
OPEN_PAGE = "Open the page"

NEW_BLOCK = "Write a commented file of step blocks"
NEW_SHIPPED = "Copy the shipped stimuli, those of the paper among them"
NEW_SESSION = "Write the folder of a bench session"
PREDICT = "Predict what is felt"
BUILD = "Build, read back and measure"
DRAW = "Write drawings, inspection sheets and setups"
DESIGN = "Design a study with these stimuli"
LIST_CHANNELS = "List the channels of the scan"
MEASURE = "Measure the features of every trace"
LOOP = "Find what the model lacks"
SHEETS = "Write blinded run sheets"

DECLARE = "Declare"
DECLARE_HELP = (
    "A field takes what a stimulus file takes: a quantity with its unit (25 um), a name, or a "
    'table such as { nominal = "25 um", tolerance = "1 um" }. What is left empty has its default.'
)
STIMULUS_FILE = "Stimulus file, there or new (such as mine.toml)"
STIMULUS_FILES_ARE = "Stimulus files in the folder:"
NONE = "none"
OPEN = "Open"
STANZA = "Stimulus"
KIND = "Kind of a new one"
ADD_STANZA = "Add"
NO_NAME = "without a name"
DEFAULT = "Left out: {value}."
REQUIRED = "Must be given."
SAVE = "Save"
SAVED = "{name} is saved"
MORE_MISTAKES = "... and {count} more"
FELT = "What is felt"
FELT_COLUMNS = {
    "part": "stimulus",
    "way": "drag",
    "angle": "critical angle, °",
    "force": "force, N (95 %)",
    "energy": "energy, µJ (95 %)",
    "distance": "to the next, JND (95 %)",
    "dragged": "energy by the drag in time, µJ",
}
FELT_LEARNED = "energy with the model, µJ (95 %)"
FELT_CONDITION = "Under the first tip, load and friction of the file; by the formula at once."
MODEL_CONDITION = "Friction and spring are those of the model {name}."
SESSION_MODEL = "Model of a session, by which to predict"
SLIDE = "{field} [{unit}]: slide, and watch what is felt"
NOT_FELT = "No part of this file is felt."
INTERVAL = "{value} ({low} to {high})"
PROFILE_OF = "Working edge of {part}, to one scale across and up"
CHANGE = "Change it in a form"

RUN = "Run"
CANCEL = "Cancel"
PROGRESS = "How far the command is"
STEP = "{done}: {name}"
STEP_OF = "{done} of {total}: {name}"
WORK = "Work"
NO_WORK = "Nothing runs, and nothing has run since the window was opened."
RUNNING = "running"
DONE = "done"
OUT_OF_TOLERANCE = "done: something is out of tolerance"
WRONG_INPUT = "not done: the input is wrong"
NOT_PROVEN = "done: something is not proven"
CANCELLED = "cancelled"
LOST = "not finished: it ended together with the window; run it again"
RUN_AGAIN = "Run again"
FAILED = "ended with an internal error, which is no verdict"

INSPECT = "Inspect"
INSPECT_THIS = "Judge the scan by ISO 14253-1"
INSPECT_LINK = "Look at it and judge it"
DROP_SCAN = "Drop scans here, or choose them: they are put into the folder scans"
SCAN = "Scan in the folder"
PART = "Part that was scanned"
UNIT = "Unit, where the file says none (um; x=mm,z=um)"
CHANNEL = "Channel or column, of several"
STYLUS = "Radius of the stylus (2 um; optical: 0 um)"
CALIBRATION = "Vertical calibration, uncertainty (0.1 %)"
LOOK = "Look"
CHOOSE_PART = "Choose the part that was scanned: the command stands here then."
SCAN_PICTURE = "Heights of the scan"
PROFILE_READ = "Profile of {points} points over {length}, heights from {low} to {high}"
MAP_READ = "Map of {columns} x {rows} points over {length} x {width}, heights from {low} to {high}"
EDGE = "{number}: {rise} µm at {place} µm"
PICK_EDGE = (
    "The scan has several edges. Where the program cannot tell which is the working one, click on "
    "it, or choose it here: only the part that holds it alone is evaluated then."
)
WORKING_EDGE = "Working edge"
BATCH = "Several scans at once, each of a serial number"
BATCH_HELP = (
    "Drop the scans first: those of the folder {folder} are offered. Scans with one serial number "
    "are evaluated together. The list is written beside them, and the command takes it."
)
STIMULUS_FILE_OF_PARTS = "Stimulus file that declares the parts"
BATCH_SCANS = "Scans"
SERIAL = "Serial number"
WRITE_LIST = "Write the list"
INSPECT_BATCH = "Judge all scans of the list"
AXIS_ALONG = "along the scan [mm]"
AXIS_ACROSS = "across it [mm]"
AXIS_HEIGHT = "height [µm]"

BUILD_PAGE = "Build"
BUILD_FILES = "Stimulus files"
NO_STIMULI = "No stimulus file lies in the folder yet: declare one first."
LOOK_WHAT_CHANGED = "Look what changed"
OUTDATED = "To be made, new or changed: {names}"
CURRENT = "Up to date: {names}"
BUNDLE = "Bundle for the workshop: drawings, sheets, setups, and an archive for a quotation"
SIMULATOR = "Simulator"
SCENES = "Scenes for the simulator {simulator}"
VERDICTS = "Verdict of every file"
VERDICT_COLUMNS = {
    "part": "stimulus",
    "file": "file",
    "within": "measurements within tolerance",
    "failures": "out of tolerance",
}
WITHIN = "{count} of {total}"
DOWNLOAD = "Take {name}"
REPORT_OF = "Page of: {title}"

MUST_BE_SAID = "must be answered first: {label}"

STUDY_PAGE = "Study"
STUDY_HELP = (
    "From the design to the analysis. The preregistration says what will be compared before "
    "anybody has answered."
)
NO_STUDY = "No study lies in the folder yet: design one first."
STUDY = "Study (its folder)"
STUDY_FILE = "Stimulus file"
STUDY_FOLDER = "Folder of the study"
SEED = "Seed of all random choices"
EXPERIMENT = "Experiment"
PARTICIPANTS = "Participants"
PROBES = "Conditions, with commas between them"
REPETITIONS = "Repetitions of every condition"
STANDARD = "Block that all others are compared with (constant, adaptive)"
PARTICIPANT = "Number of the participant"
PRACTICE = "Trials with feedback before the first, not recorded"
PORT = "Port of the participant's page on this machine"
RUN_STUDY = "Lead a participant through the trials"
OPEN_SERVED = "Open the page of the participant"
SIMULATE_STUDY = "Let simulated participants answer"
ANSWERS_TO_WRITE = "Answers to write"
ANSWERS = "Answers: filled-in run sheets, or a folder of them"
ANALYSE = "Analyse the answers"
REPORT_FOLDER = "Folder of the report"
REFERENCE = "Condition that the others are compared with"

SET_PAGE = "Set"
SET_HELP = (
    "Blocks by what is felt: the program finds the heights or gaps whose vibration energies are "
    "wanted. Give targets one by one, or the lowest with two of highest, number and distance."
)
DESIGN_SET = "Design a set by what is felt"
SET_FILE = "Stimulus file to write"
TARGETS = "Targets, by commas (20 uJ, 30 dB)"
LOWEST = "Lowest target (2 uJ)"
HIGHEST = "Highest target"
NUMBER = "How many"
NEIGHBOURS_APART = "Distance of neighbours (1 JND)"
SET_KIND = "Kind of blocks"
SET_BASE = "Stimulus file for what is not said"
SET_LOAD = "Normal load (1 N)"
SET_FRICTION = "Coefficient of friction"
SET_STEP = "Sizes are whole multiples of (0.1 um)"
SET_PLOT = "Picture of targets and blocks"
AXIS_HELP = (
    "Drag a target along the axis, or move it with the arrow keys (Page Up and Down: one just "
    "noticeable difference; Delete takes it away). The blocks below follow, and the command, too."
)
TARGET_AXIS = "Targets above, and blocks below, on the axis of energies"
AXIS_ENERGY = "vibration energy, µJ"
TARGET = "Target {number}"
BLOCK_SIZE = "{size} µm"
ADD_TARGET = "Add a target"
DESIGNING = "The blocks are sought ..."
DESIGNED_BY_FORMULA = "By the formula."
DESIGNED = "As the command designs it."
SET_PICTURE = "Targets and blocks on the axis of energies"
DECLARE_SET = "Change the set in a form"

BENCH_PAGE = "Bench"
BENCH_HELP = (
    "A session is a folder with its traces and the table of its trials. Say which column is which "
    "beside the first trace; measure it, and find what the model lacks."
)
DROP_SESSION = "Drop a session as a zip file: it is put into the folder sessions"
SESSION = "Session (its folder)"
TANGENTIAL = "Force along the drag"
NORMAL = "Normal force"
TIME = "Time"
COLUMNS_HELP = (
    "Which column of the trace is which; a unit (mN) where the name of the column says none, and a "
    "factor where signs are reversed (-1) or the gauge is in volts (2.35 N/V)."
)
UNIT_PART = "unit"
FACTOR_PART = "factor"
SAMPLE_RATE = "Sample rate (10 kHz)"
RANGE = "Force at which the sensor saturates (5 N)"
TRACES = "Files of the traces (traces/{trial:04d}.csv)"
SPRING = "Spring constant of the probe along the drag (9.81 N/mm)"
TIP_RADIUS = "Radius of the tip (125 um)"
NO_TRACE = "No trace in text is there by this pattern yet, so none is shown."
FIRST_TRACE = "First trace; its columns: {columns}"
TRACE_PICTURE = "Columns of the first trace"
AXIS_ROWS = "row"
CHECK_SESSION = "Hold some trials against what is declared"
CHECK_HEADING = "What the traces say of the declaration"
CHECK_HELP = (
    "Ramps show the spring, the standing force the load, the time of the traces the sample rate; "
    "sixteen trials at most are measured."
)
CHECKED = "{measured} of {total} trials could be measured."
CHECK_IS_OLD = "session.toml was changed since: run the check again."
CHECK_COLUMNS = {
    "quantity": "quantity",
    "declared": "declared",
    "shown": "shown (95 %)",
    "ratio": "shown over declared (95 %)",
    "verdict": "verdict",
}
SPRING_CONSTANT = "spring constant"
SET_LOADS = "normal load, by the gauge"
BY_TRIAL = "in the table of trials"
NEWTON_PER_MILLIMETRE = "{value} N/mm"
HERTZ = "{value} Hz"
RATE = "sample rate, by the time column"
RING = "ring of the tool"
AGREES = "agrees"
CONTRADICTED = "contradicted"
CONTRADICTED_BY_FACTOR = "contradicted: about {factor} times as much"
CONTRADICTED_BY_SHARE = "contradicted: about 1/{factor} of it"
RINGS_AS_USUAL = "as tools ring, which speaks for the sample rate"
RINGS_UNUSUALLY = "not where tools ring (250 to 350 Hz): is the sample rate right?"
NOT_MEASURED = "The first that could not: {reason}"
FIGURES = {"vibration_energy_j": "Vibration energy", "peak_force_n": "Peak force"}
FOUND = "{finding} ({verdict})"
ERROR_COLUMNS = {
    "model": "model",
    "energy": "error of the energy, %",
    "force": "error of the peak force, %",
}
ERRORS = "Error on trials held out, before and after"
BEFORE = "nominal model"
AFTER = "model with what was found"
APART = "Held apart: {trials}"
APART_TRIAL = "{trial} ({looks_like})"
NEXT_EXPERIMENT = "The next experiment"
NO_EXPERIMENT = "None is asked for: nothing is left open."
NEXT_REASON = "It would tell {first} from {second}, mainly by the {channel}."
NEXT_CONFIRMS = "It would confirm {first}, mainly by the {channel}."
EVERYTHING = "whole of a trial"
NEXT_OPEN = "{sentence}."
ONE_REPEAT = "One trial at the first setting of the table is expected to decide"
REPEATS = "{repeats} trials at the first setting of the table are expected to decide"
NEXT_BLOCK = "Make the block {name}, {height} high: {file} is its file"
DECLARE_BLOCK = "Open the file of the block in a form"
NEXT_SETTINGS = "Settings, the best first"
EXPECTED_GAIN = "evidence per trial (fall of the criterion)"
AGREEMENT = "Measured over predicted, trial by trial"
AGREEMENT_HELP = "Click on a point, or choose its trial in the list, to see its trace."
AGREEMENT_AXIS = "measured over predicted"
AXIS_TRIALS = "trial"
SERIES_BEFORE = "before"
SERIES_AFTER = "after"
SERIES_APART = "held apart"
SHOWN_FIGURE = "Figure"
TRIAL = "Trial"
TRIAL_NAME = "{trial}: {block}"
TRIAL_PICTURE = "Trace of trial {trial}"
NO_TRIAL_PICTURE = "The trace of this trial cannot be read."
DRAW_TRIAL = "Draw the trace of trial {trial}"
PREDICT_SESSION = "Predict the trials of the session with what was found"
MODEL_OF = "What was found is kept as a model: {name}"
USE_MODEL = "Use the model on the page to declare"

BUILD_BY_MODEL = "Build, with predictions by the model of a session"
DRAGGING = "The drag in time follows."
SHOW_PART = "The part in 3-D, and its drawing"
MAKING_PART = "The kernel makes {part} ..."
SOLID_OF = "{part} in 3-D"
DRAWING_OF = "Drawing of {part}"
TRUE_SCALE = "At true scale; drag to turn it."
STRETCHED = "Heights over the lower face times {factor}; drag to turn it."
