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
