"""Makers' libraries, spoken to through their C interface: stubs with the same ABI, compiled here,
take their place.
"""

import shutil
import subprocess
import time

import numpy as np
import pytest

from stepblocks.contact.counterface import Step
from stepblocks.contact.operating_point import PAPER
from stepblocks.errors import PipelineError, StudyError
from stepblocks.haptics.hands import ForceDimension, OpenHaptics
from stepblocks.haptics.renderer import Renderer
from stepblocks.haptics.servo import RATE, Servo

# signatures as in dhdc.h; the hand moves along the device's y, which points to the right
DHD = """
#include <string.h>
#include <unistd.h>
static double force[3]; static int enabled, ticks, fails, hangs; static volatile int pressed = -1;
int dhdOpen(void) { return fails ? -1 : 0; }
int dhdClose(char ID) { enabled = -1; return 0; }
int dhdEnableForce(unsigned char on, char ID) { if (ID != -1) return -1; enabled = on; return 0; }
int dhdGetPosition(double *x, double *y, double *z, char ID)
{ *x = 0.003; *y = -0.004 + 2e-5 * ticks++; *z = 0.0115;
  if (hangs) { usleep(1000 * hangs); hangs = 0; }
  if (pressed >= 0) *y = -0.004; /* it stays before the edge */
  return fails || ID != -1 ? -1 : 0; }
int dhdGetLinearVelocity(double *x, double *y, double *z, char ID) { *x = 0; *y = 0.02; *z = 0;
  return 0; }
int dhdSetForce(double x, double y, double z, char ID) { force[0] = x; force[1] = y;
  force[2] = z; return ID == -1 ? 0 : -1; }
int dhdGetButton(int index, char ID) {
  return index == 0 && (pressed < 0 ? ticks > 5 && ticks < 400 : pressed); }
const char *dhdErrorGetLastStr(void) { return "no device found"; }
void stub_force(double *out) { memcpy(out, force, sizeof force); }
int stub_enabled(void) { return enabled; }
void stub_fail(int on) { fails = on; }
void stub_hang(int ms) { hangs = ms; }
void stub_press(int on) { pressed = on; }
"""

# types as in hd.h and hdDefines.h: the scheduler calls back from a thread of its own
HD = """
#include <pthread.h>
#include <string.h>
#include <unistd.h>
typedef struct { unsigned code; int internal; unsigned device; } HDErrorInfo;
typedef unsigned (*Callback)(void *);
static Callback call; static void *data; static volatile int on; static pthread_t thread;
static double force[3]; static int ticks, inside, misused; static unsigned fails;
static void *loop(void *_) { while (on) { if (call && call(data) != 1) break; usleep(1000);
  } return 0; }
unsigned hdInitDevice(const char *name) { return name ? 0xFFFFFFFF : 7; }
HDErrorInfo hdGetError(void) { HDErrorInfo e = { fails, 0, 7 }; return e; }
const char *hdGetErrorString(unsigned code) { return code == 0x301 ? "maximum force" : "?"; }
void hdEnable(unsigned what) { if (what != 0x4000) misused = 1; }
unsigned long hdScheduleAsynchronous(Callback c, void *d, unsigned short priority) { call = c;
  data = d; return 42; }
void hdUnschedule(unsigned long handle) { if (handle != 42) misused = 1; call = 0; }
void hdStartScheduler(void) { on = 1; pthread_create(&thread, 0, loop, 0); }
void hdStopScheduler(void) { on = 0; pthread_join(thread, 0); }
void hdDisableDevice(unsigned device) { if (device != 7) misused = 1; }
void hdBeginFrame(unsigned device) { if (device != 7 || inside) misused = 1; inside = 1; ++ticks; }
void hdEndFrame(unsigned device) { if (!inside) misused = 1; inside = 0; }
void hdGetDoublev(unsigned what, double *out) {
  if (!inside) misused = 1;
  if (what == 0x2050) { out[0] = -4.0; out[1] = 11.0; out[2] = 3.0; }
  if (what == 0x2051) { out[0] = 20.0; out[1] = 1.0; out[2] = 2.0; } }
void hdGetIntegerv(unsigned what, int *out) { *out = what == 0x2000 ? 1 : 0; }
void hdSetDoublev(unsigned what, const double *in) { if (what != 0x2700 || !inside) misused = 1;
  memcpy(force, in, sizeof force); }
void stub_force(double *out) { memcpy(out, force, sizeof force); }
int stub_misused(void) { return misused; }
void stub_fail(unsigned code) { fails = code; }
"""


@pytest.fixture(scope="module")
def stubs(tmp_path_factory):
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    folder = tmp_path_factory.mktemp("stubs")
    for name, code in (("dhd", DHD), ("HD", HD)):
        (folder / f"{name}.c").write_text(code)
        command = [
            compiler,
            "-shared",
            "-fPIC",
            "-o",
            folder / f"lib{name}.so",
            folder / f"{name}.c",
            "-lpthread",
        ]
        subprocess.run(command, check=True)
    return folder


def force_of(hand):
    out = (__import__("ctypes").c_double * 3)()
    hand._lib.stub_force(out)
    return list(out)


def test_force_dimension_is_felt_along_its_own_axes(stubs):
    hand = ForceDimension(str(stubs / "libdhd.so"))
    position, velocity, held = hand.read()
    assert position == pytest.approx([-0.004, -0.003, 0.0115])
    assert velocity == pytest.approx([0.02, 0.0, 0.0])
    assert not held
    hand.apply(np.array([1.0, 2.0, 3.0]))
    assert force_of(hand) == [-2.0, 1.0, 3.0]
    renderer = Renderer(Step(50e-6).centre_path(PAPER.ball_radius), PAPER, scale=100.0, rate=RATE)
    servo = Servo(renderer, hand, waits=False, seconds=0.6)
    servo.run()
    record = servo.get_log_columns()
    assert servo.ended == "time is up"
    assert record["applied_x_n"].min() < -0.1  # it is held back at the edge
    assert (record["held"] == 0.0).sum() > 100  # the button was let go
    assert force_of(hand) == [0.0, 0.0, 0.0]
    hand.close()
    assert hand._lib.stub_enabled() == -1


def until(holds, seconds=20.0):
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.002)


@pytest.mark.parametrize(
    ("trouble", "said"), [("hang", "the hand did not answer"), ("fail", "must tell its position")]
)
def test_a_device_in_doubt_pushes_again_when_its_switch_was_let_go_and_taken(stubs, trouble, said):
    """No page and no mouse has a part in it; the press before the trial does not count either."""
    hand = ForceDimension(str(stubs / "libdhd.so"))
    lib = hand._lib
    lib.stub_press(1)
    servo = Servo(
        Renderer(Step(50e-6).centre_path(PAPER.ball_radius), PAPER, scale=100.0, rate=RATE), hand
    )
    servo.start()
    try:
        until(lambda: servo.ticks > 50)
        assert not any(force_of(hand))  # held since before the trial began
        for _ in range(2):
            # a busy machine may be late, and be let go by the watchdog, on the way
            while not any(force_of(hand)):
                lib.stub_press(0)
                until(lambda: servo.trusted)
                lib.stub_press(1)
                time.sleep(0.02)
            lib.stub_hang(120) if trouble == "hang" else lib.stub_fail(1)
            until(lambda: said in " ".join(servo.doubts[-2:]) and not servo.trusted)
            assert not any(force_of(hand))
            lib.stub_fail(0)
            until(lambda after=servo.ticks + 50: servo.ticks > after)
            assert not any(force_of(hand))  # still held: it was not let go
    finally:
        lib.stub_fail(0)
        lib.stub_press(-1)
        servo.stop()
        hand.close()
    assert servo.ended == "stopped"
    assert len(servo.doubts) >= 2


def test_openhaptics_calls_back_and_every_frame_is_begun_and_ended(stubs):
    hand = OpenHaptics(str(stubs / "libHD.so"))
    try:
        hand.apply(np.array([1.0, 2.0, 3.0]))
        end = time.monotonic() + 5.0
        while time.monotonic() < end and (force_of(hand) != [1.0, 3.0, -2.0] or not hand.read()[2]):
            time.sleep(0.005)
        position, velocity, held = hand.read()
        # millimetres, y up, z to the operator
        assert position == pytest.approx([-4e-3, -3e-3, 11e-3])
        assert velocity == pytest.approx([20e-3, -2e-3, 1e-3])
        assert held
        assert force_of(hand) == [1.0, 3.0, -2.0]
    finally:
        hand.close()
    assert hand._lib.stub_misused() == 0


def test_what_the_maker_s_library_says_is_reported(stubs):
    import ctypes

    dhd, hd = (ctypes.CDLL(str(stubs / f"lib{name}.so")) for name in ("dhd", "HD"))
    dhd.stub_fail(1)
    hd.stub_fail(0x301)
    try:
        with pytest.raises(PipelineError, match="the device must be opened: no device found"):
            ForceDimension(str(stubs / "libdhd.so"))
        with pytest.raises(PipelineError, match="the device must be opened: maximum force"):
            OpenHaptics(str(stubs / "libHD.so"))
    finally:
        dhd.stub_fail(0)
        hd.stub_fail(0)


def test_a_library_that_is_not_there_is_named():
    with pytest.raises(PipelineError, match=r"cannot be loaded: .*\[/nowhere/libdhd.so\]"):
        ForceDimension("/nowhere/libdhd.so")
    with pytest.raises(StudyError, match="the library HD must be installed to use this device"):
        OpenHaptics()
