// The page: what is chosen, the hand, sound, gamepad, blind trials, and the record.
const STIMULI = JSON.parse(document.getElementById("stimuli").textContent);
const RATE = 10000; // ticks per second
const BEFORE = 0.02; // kept before a release [s]
const AFTER = 0.06; // kept after it [s]
const LONGEST = 20; // of a record [s]
const SMALLEST_TIP = 1; // radius that the box takes [um]
const LARGEST_TIP = 1000;
const VIEW = 1.5e-3; // width of the picture [m]
const $ = id => document.getElementById(id);
const history = new Float64Array(RATE / 2); // force on the hand, the newest last [N]

let probe; // the tip
let stimulus; // that is felt
let tool; // what the controls say
let path; // of the tip over the stimulus
const paths = new Map(); // that were built so far
let tipRadius; // of the ball [m]: what the box showed when it was last right
let side = "block"; // which of the two blocks is felt
let hand; // where the hand is [m]
let wanted; // where it goes [m]
let place = -0.5; // the same on the canvas, from -1 to 1
let grabbed = false; // whether a pointer holds the hand
let last = null; // time of the last frame [ms]
let heard = 0; // releases that have sounded
let since = -1; // ticks since the last release; negative where none is awaited
let kept = null; // the last release, as it is drawn
let answer = null; // indices of the two stimuli of a blind trial
let right = 0; // answers so far
let asked = 0;
let record = null; // ticks of the record that runs
let recorded = null; // and of the last one
let named = null; // its file and the command that reads it
let audio = null;

const toMicrometres = metres => +(metres * 1e6).toPrecision(7);
const toFourDigits = value => +value.toPrecision(4);

// The path of a stimulus under a ball, built once.
function getPath(one, variant, radius) {
  const key = `${STIMULI.indexOf(one)} ${variant} ${radius}`;
  if (!paths.has(key)) {
    paths.set(key, buildPath(one.variants[variant], radius));
  }
  return paths.get(key);
}

// What the controls say, with what the stimulus declares of its tool.
function readTool() {
  const { stiffness, conversion, frequency, decay, limit } = stimulus;
  return {
    stiffness,
    conversion,
    frequency,
    decay,
    limit,
    load: +$("load").value,
    friction: +$("friction").value,
    vibration: $("ring").checked,
  };
}

const radius = () => tipRadius;
function release() {
  return predict(path, 1, tool);
}

// How far the hand must go to release a stimulus, and a little further [m].
function computeReach(one, under) {
  const found = predict(under, 1, tool);
  const force = isFinite(found.force)
    ? Math.min(found.force, tool.limit)
    : Math.min(tool.limit, 20);
  return Math.max(0.5 * VIEW, found.x + (1.3 * force) / tool.stiffness);
}

// In blind trials both blocks have the same reach, so that it tells nothing.
function findReach() {
  if (!answer) {
    return computeReach(stimulus, path);
  }
  const variant = +$("variant").value;
  const reaches = answer
    .map(i => STIMULI[i])
    .map(one => computeReach(one, getPath(one, variant, radius())));
  return Math.max(...reaches);
}

// Where the hand is for a place on the canvas from -1 to 1: to scale in the middle, further towards
// the ends.
function toHand(at) {
  const outer = Math.max(Math.abs(at) - 0.5, 0);
  const further = 4 * outer ** 2 * (findReach() - 0.5 * VIEW);
  return at * 0.5 * VIEW + Math.sign(at) * further;
}

function moveHand(at) {
  place = clamp(at, -1, 1);
  wanted = toHand(place);
  $("scene").setAttribute("aria-valuenow", Math.round(place * 100));
}

// Forget the last release, and empty its pictures.
function forgetRelease() {
  since = -1;
  kept = null;
  heard = 0;
  history.fill(0);
  for (const id of ["zoom", "force", "spectrum"]) {
    clear(id);
  }
  $("shares").textContent = "";
}

// Take a stimulus; `declared` puts the controls to what its file declares.
function choose(which, declared = !answer) {
  if (typeof which === "string") {
    side = which;
  }
  const before = stimulus;
  const drawn = answer?.[side === "block" ? 0 : 1];
  stimulus = STIMULI[drawn ?? $(side).value];
  $("a").setAttribute("aria-pressed", String(side === "block"));
  $("b").setAttribute("aria-pressed", String(side !== "block"));
  if (declared && before !== stimulus) {
    setDeclared();
  }
  restart();
}

function setDeclared() {
  const variants = stimulus.variants.map((one, i) => new Option(one.label, i));
  $("variant").replaceChildren(...variants);
  $("variant-label").hidden = variants.length < 2;
  tipRadius = stimulus.radius;
  $("tip").value = toMicrometres(tipRadius);
  $("load").min = Math.min(0.05, stimulus.load);
  $("load").max = Math.max(2, stimulus.load);
  $("friction").max = Math.max(0.5, stimulus.friction);
  $("load").value = stimulus.load;
  $("friction").value = stimulus.friction;
  $("declared").textContent =
    `${stimulus.set}: tip ${toMicrometres(stimulus.radius)} µm, ${stimulus.load} N, ` +
    `friction ${stimulus.friction}, ring ${+stimulus.frequency.toFixed(1)} Hz`;
}

function restart() {
  tool = readTool();
  path = getPath(stimulus, +$("variant").value || 0, radius());
  probe = new Probe(path, tool);
  forgetRelease();
  moveHand(answer ? -0.4 : clamp((release().x - 250e-6) / (0.5 * VIEW), -0.5, 0.5));
  hand = wanted;
  retune();
}

// Take what the controls say; a record ends, for it is of one stimulus under one condition.
function retune() {
  if (record) {
    stopRecord();
  }
  tool = readTool();
  probe.tool = tool;
  $("load-text").textContent = `${toFourDigits(tool.load)} N`;
  $("friction-text").textContent = toFourDigits(tool.friction);
}

// What two stimuli of a blind trial have in common: set, tip, load, friction and tool.
const CONDITIONS = [
  "set",
  "radius",
  "load",
  "friction",
  "stiffness",
  "conversion",
  "frequency",
  "decay",
  "limit",
];
function differInShapeAlone(one, other) {
  return (
    one !== other &&
    CONDITIONS.every(name => one[name] === other[name]) &&
    one.variants.length === other.variants.length
  );
}

// Draw two stimuli at random, of the set that is felt where it has a pair.
function drawPair() {
  const pairs = STIMULI.flatMap((one, i) =>
    STIMULI.map((_, j) => [i, j]).filter(([, j]) => differInShapeAlone(one, STIMULI[j])),
  );
  const here = pairs.filter(([i]) => STIMULI[i].set === stimulus.set);
  const from = here.length ? here : pairs;
  return from.length ? from[Math.floor(Math.random() * from.length)] : null;
}

// Begin a blind trial, or end the last one where none is wanted.
function beginBlind() {
  answer = null;
  if ($("blind").checked) {
    const pair = drawPair();
    if (pair) {
      stimulus = STIMULI[pair[0]];
      setDeclared();
    }
    answer = pair;
    $("blind").checked = Boolean(pair);
  }
  for (const id of ["block", "other", "variant", "tip", "load", "friction", "record", "ring"]) {
    $(id).disabled = Boolean(answer);
  }
  $("ask").hidden = !answer;
  $("pictures").hidden = Boolean(answer);
  $("declared").hidden = Boolean(answer);
  if (!answer) {
    stimulus = null;
  }
  choose("block");
}

function judgeAnswer(guess) {
  const names = answer.map(i => STIMULI[i].name);
  const [one, two] = answer.map(
    i => predict(getPath(STIMULI[i], +$("variant").value, radius()), 1, tool).angle,
  );
  asked++;
  right += one === two || (guess === 0) === one > two;
  $("score").textContent = `${right} of ${asked} right; A was ${names[0]}, B was ${names[1]}`;
  beginBlind();
}

function playRing(force) {
  if (!$("sound").checked) {
    return;
  }
  audio = audio || new AudioContext();
  const tone = audio.createOscillator();
  const gain = audio.createGain();
  const now = audio.currentTime;
  tone.frequency.value = tool.frequency;
  gain.gain.setValueAtTime(clamp(0.3 * force, 1e-3, 0.8), now);
  gain.gain.exponentialRampToValueAtTime(1e-4, now + 8 * tool.decay);
  tone.connect(gain).connect(audio.destination);
  tone.start(now);
  tone.stop(now + 8 * tool.decay);
}

// A pulse of the gamepad or the telephone; neither knows newton, so its strength is relative.
function vibrate(force) {
  const length = Math.ceil(3000 * tool.decay);
  const strength = clamp(force / 5, 0.05, 1);
  for (const pad of navigator.getGamepads?.() ?? []) {
    pad?.vibrationActuator
      ?.playEffect?.("dual-rumble", {
        duration: length,
        weakMagnitude: strength,
        strongMagnitude: 0,
      })
      ?.catch(() => {});
  }
  if (navigator.userActivation?.hasBeenActive) {
    navigator.vibrate?.(length);
  }
}

// The left stick of a gamepad moves the hand; a press of its first button puts the probe back.
function readPad(seconds) {
  for (const pad of navigator.getGamepads?.() ?? []) {
    if (!pad) {
      continue;
    }
    $("pad").textContent = "gamepad: left stick drags";
    const axis = Math.abs(pad.axes[0]) > 0.08 ? pad.axes[0] : 0;
    if (axis) {
      moveHand(place + Math.sign(axis) * axis * axis * seconds);
    }
    if (pad.buttons[0]?.pressed) {
      choose(side, false);
    }
    return;
  }
}

// What the user does, tick by tick, as CSV that `stepblocks compare` reads.
function startRecord() {
  const file = `feel-${stimulus.name}.csv`;
  const tip = `--tip-radius "${toMicrometres(radius())} um"`;
  const at = `--load "${tool.load} N" --friction ${tool.friction} ${tip}`;
  named = {
    file,
    command: `stepblocks compare ${file} --to "${stimulus.file}/${stimulus.name}" ${at}`,
  };
  record = [];
  recorded = null;
  $("record").textContent = "stop and save";
}

function stopRecord() {
  recorded = record;
  record = null;
  $("record").textContent = "record";
  if (!recorded.length) {
    return;
  }
  const rows = recorded.map((row, i) =>
    [(i / RATE).toFixed(4), ...row.map(value => +value.toPrecision(9))].join(","),
  );
  const link = document.createElement("a");
  link.href = URL.createObjectURL(
    new Blob(["time_s,hand_m,tip_m,force_n,ring_n,releases\n" + rows.join("\n") + "\n"], {
      type: "text/csv",
    }),
  );
  link.download = named.file;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  $("compare").textContent = named.command;
}

const WHY = {
  locked: "self-locked here: no pull lifts the probe over this edge",
  "too-high": "the ball meets the wall: no pull lifts it",
  "no-catch": "nothing catches in this direction",
};
function describe() {
  const found = release();
  const releases = found.status === "releases";
  const state = $("state");
  state.className = releases || found.status === "no-catch" ? "" : "locked";
  let said = `slips at ${found.force.toFixed(3)} N`;
  if (!releases) {
    const limit = `${stimulus.limiter} (${tool.limit} N)`;
    said = WHY[found.status] ?? `${said}, beyond what ${limit}: it does not slip`;
  }
  const lastly = probe.events
    ? `; last release at ${Math.abs(probe.released).toFixed(3)} N, E_v ${energy(probe.released)}`
    : "";
  state.textContent = `Pull ${probe.pull.toFixed(3)} N; ${said}${lastly}`;
}

let frame = 0;
function animate(now) {
  const ticks = last === null ? 0 : Math.min(Math.round(((now - last) * RATE) / 1000), RATE / 10);
  last = now;
  readPad(ticks / RATE);
  const from = hand;
  const forces = [];
  let at = null;
  for (let n = 1; n <= ticks; n++) {
    hand = from + ((wanted - from) * n) / ticks;
    forces.push(probe.tick(hand, 1 / RATE));
    if (record) {
      record.push([hand, probe.x, forces[n - 1], probe.ring, probe.events]);
    }
    if (probe.events > heard) {
      heard = probe.events;
      at = n;
      if (tool.vibration) {
        playRing(Math.abs(probe.released));
        vibrate(Math.abs(probe.released));
      }
    }
  }
  if (record && record.length >= LONGEST * RATE) {
    stopRecord();
  }
  history.copyWithin(0, ticks);
  history.set(forces, history.length - ticks);
  if (at !== null) {
    since = ticks - at;
  } else if (since >= 0) {
    since += ticks;
  }
  if (answer) {
    $("state").className = "";
    $("state").textContent = "Feel A and B, then say which catches more";
  } else {
    describe();
  }
  draw();
  if (frame++ % 6 === 0) {
    plot();
  }
  requestAnimationFrame(animate);
}

function toPlace(event) {
  const box = $("scene").getBoundingClientRect();
  return (2 * (event.clientX - box.left)) / box.width - 1;
}
$("scene").addEventListener("pointerdown", event => {
  grabbed = true;
  moveHand(toPlace(event));
  $("scene").setPointerCapture(event.pointerId);
});
$("scene").addEventListener("pointermove", event => {
  if (grabbed) {
    moveHand(toPlace(event));
  }
});
$("scene").addEventListener("pointerup", () => {
  grabbed = false;
});
document.addEventListener("keydown", event => {
  if (/SELECT|INPUT/.test(event.target.tagName) && event.target.type !== "checkbox") {
    return;
  }
  const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (way) {
    moveHand(place + way * (event.shiftKey ? 0.002 : 0.02));
    event.preventDefault();
  }
  if (/^[aA]$/.test(event.key)) {
    choose("block");
  }
  if (/^[bB]$/.test(event.key)) {
    choose("other");
  }
  if (event.key === "0") {
    choose(side, false);
  }
});
for (const id of ["block", "other"]) {
  $(id).addEventListener("change", () => choose(id));
}
$("variant").addEventListener("change", restart);
// a radius beyond the limits of the box becomes the nearest; what is no number changes nothing
$("tip").addEventListener("change", () => {
  const wish = parseFloat($("tip").value);
  if (isFinite(wish)) {
    tipRadius = clamp(wish, SMALLEST_TIP, LARGEST_TIP) * 1e-6;
  }
  $("tip").value = toMicrometres(tipRadius);
  restart();
});
$("a").addEventListener("click", () => choose("block"));
$("b").addEventListener("click", () => choose("other"));
$("blind").addEventListener("change", beginBlind);
$("say-a").addEventListener("click", () => judgeAnswer(0));
$("say-b").addEventListener("click", () => judgeAnswer(1));
$("record").addEventListener("click", () => (record ? stopRecord() : startRecord()));
// what a file declares acts as it stands; a slider that is moved stops at thousandths
for (const id of ["load", "friction"]) {
  $(id).addEventListener("input", () => {
    $(id).value = Math.round(1000 * $(id).value) / 1000;
    retune();
  });
}
$("ring").addEventListener("input", retune);
choose("block");
requestAnimationFrame(animate);
