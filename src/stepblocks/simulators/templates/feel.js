// The page: what is chosen, the hand, pictures, sound, gamepad, blind trials, and the record.
const STIMULI = JSON.parse(document.getElementById("stimuli").textContent);
const RATE = 10000, BEFORE = 0.02, AFTER = 0.06; // ticks per second; kept about a release [s]
const LONGEST = 20; // of a record [s]
const VIEW = 1.5e-3; // width of the picture [m]
const $ = id => document.getElementById(id);
const history = new Float64Array(RATE / 2);

let probe, stimulus, tool, path, hand, wanted, place = -0.5, side = "block", grabbed = false, last = null, audio = null, heard = 0;
let since = -1, kept = null, answer = null, right = 0, asked = 0, record = null, recorded = null, named = null, paths = new Map();

const micro = metres => +(metres * 1e6).toPrecision(7);
const short = value => +value.toPrecision(4);

// The path of a stimulus under a ball, built once.
function pathOf(one, variant, radius) {
  const key = `${STIMULI.indexOf(one)} ${variant} ${radius}`;
  if (!paths.has(key)) paths.set(key, buildPath(one.variants[variant], radius));
  return paths.get(key);
}
// What the controls say, with what the stimulus declares of its tool.
function readTool() {
  const { stiffness, conversion, frequency, decay, limit } = stimulus;
  return { stiffness, conversion, frequency, decay, limit, load: +$("load").value, friction: +$("friction").value, vibration: $("ring").checked };
}
const radius = () => +$("tip").value * 1e-6;
function release() { return predict(path, 1, tool); }

// Where the hand is for a place on the canvas from -1 to 1: to scale in the middle, further towards the
// ends. In blind trials both blocks have the same reach, so that it tells nothing.
function reachOf(one, under) {
  const found = predict(under, 1, tool), force = isFinite(found.force) ? Math.min(found.force, tool.limit) : Math.min(tool.limit, 20);
  return Math.max(0.5 * VIEW, found.x + 1.3 * force / tool.stiffness);
}
function reach() {
  if (!answer) return reachOf(stimulus, path);
  return Math.max(...answer.map(i => reachOf(STIMULI[i], pathOf(STIMULI[i], +$("variant").value, radius()))));
}
function toHand(at) { return at * 0.5 * VIEW + Math.sign(at) * 4 * Math.max(Math.abs(at) - 0.5, 0) ** 2 * (reach() - 0.5 * VIEW); }
function move(at) { place = clamp(at, -1, 1); wanted = toHand(place); $("scene").setAttribute("aria-valuenow", Math.round(place * 100)); }

function forget() { since = -1; kept = null; heard = 0; history.fill(0); for (const id of ["zoom", "force", "spectrum"]) clear(id); $("shares").textContent = ""; }
// Take a stimulus; `declared` puts the controls to what its file declares.
function choose(which, declared = !answer) {
  if (typeof which === "string") side = which;
  const before = stimulus;
  stimulus = STIMULI[answer ? answer[side === "block" ? 0 : 1] : $(side).value];
  $("a").setAttribute("aria-pressed", String(side === "block"));
  $("b").setAttribute("aria-pressed", String(side !== "block"));
  if (declared && before !== stimulus) setDeclared();
  restart();
}
function setDeclared() {
  const variants = stimulus.variants.map((one, i) => new Option(one.label, i));
  $("variant").replaceChildren(...variants);
  $("variant-label").hidden = variants.length < 2;
  $("tip").value = micro(stimulus.radius);
  $("load").min = Math.min(0.05, stimulus.load);
  $("load").max = Math.max(2, stimulus.load);
  $("friction").max = Math.max(0.5, stimulus.friction);
  $("load").value = stimulus.load;
  $("friction").value = stimulus.friction;
  $("declared").textContent = `${stimulus.set}: tip ${micro(stimulus.radius)} µm, ${stimulus.load} N, friction ${stimulus.friction}, ring ${+stimulus.frequency.toFixed(1)} Hz`;
}
function restart() {
  tool = readTool();
  path = pathOf(stimulus, +$("variant").value || 0, radius());
  probe = new Probe(path, tool);
  forget();
  move(answer ? -0.4 : clamp((release().x - 250e-6) / (0.5 * VIEW), -0.5, 0.5));
  hand = wanted;
  retune();
}
function retune() {
  if (record) stopRecord(); // one record, one stimulus under one condition
  tool = probe.tool = readTool();
  $("load-text").textContent = `${short(tool.load)} N`;
  $("friction-text").textContent = short(tool.friction);
}

// Two stimuli of one set that differ in nothing but themselves: same tip, load, friction, tool.
const ALIKE = ["set", "radius", "load", "friction", "stiffness", "conversion", "frequency", "decay", "limit"];
const alike = (a, b) => a !== b && ALIKE.every(name => STIMULI[a][name] === STIMULI[b][name]) && STIMULI[a].variants.length === STIMULI[b].variants.length;
function drawPair() {
  const pairs = STIMULI.flatMap((_, a) => STIMULI.map((_, b) => [a, b])).filter(([a, b]) => alike(a, b));
  const here = pairs.filter(([a]) => STIMULI[a].set === stimulus.set), from = here.length ? here : pairs;
  return from.length ? from[Math.floor(Math.random() * from.length)] : null;
}
function blind() {
  answer = null;
  if ($("blind").checked) {
    const pair = drawPair();
    if (pair) { stimulus = STIMULI[pair[0]]; setDeclared(); }
    answer = pair;
    $("blind").checked = Boolean(pair);
  }
  for (const id of ["block", "other", "variant", "tip", "load", "friction", "record", "ring"]) $(id).disabled = Boolean(answer);
  $("ask").hidden = !answer;
  $("pictures").hidden = Boolean(answer);
  $("declared").hidden = Boolean(answer);
  if (!answer) stimulus = null;
  choose("block");
}
function say(guess) {
  const names = answer.map(i => STIMULI[i].name);
  const [one, two] = answer.map(i => predict(pathOf(STIMULI[i], +$("variant").value, radius()), 1, tool).angle);
  asked++; right += one === two || (guess === 0) === (one > two);
  $("score").textContent = `${right} of ${asked} right; A was ${names[0]}, B was ${names[1]}`;
  blind();
}

function sound(force) {
  if (!$("sound").checked) return;
  audio = audio || new AudioContext();
  const tone = audio.createOscillator(), gain = audio.createGain(), now = audio.currentTime;
  tone.frequency.value = tool.frequency;
  gain.gain.setValueAtTime(clamp(0.3 * force, 1e-3, 0.8), now);
  gain.gain.exponentialRampToValueAtTime(1e-4, now + 8 * tool.decay);
  tone.connect(gain).connect(audio.destination);
  tone.start(now);
  tone.stop(now + 8 * tool.decay);
}
// A pulse of the gamepad or the telephone; neither knows newton, so its strength is relative.
function vibrate(force) {
  const length = Math.ceil(3000 * tool.decay), strength = clamp(force / 5, 0.05, 1);
  for (const pad of navigator.getGamepads?.() ?? [])
    pad?.vibrationActuator?.playEffect?.("dual-rumble", { duration: length, weakMagnitude: strength, strongMagnitude: 0 })?.catch(() => {});
  if (navigator.userActivation?.hasBeenActive) navigator.vibrate?.(length);
}
// The left stick of a gamepad moves the hand; a press of its first button puts the probe back.
function readPad(seconds) {
  for (const pad of navigator.getGamepads?.() ?? []) {
    if (!pad) continue;
    $("pad").textContent = "gamepad: left stick drags";
    const axis = Math.abs(pad.axes[0]) > 0.08 ? pad.axes[0] : 0;
    if (axis) move(place + Math.sign(axis) * axis * axis * seconds);
    if (pad.buttons[0]?.pressed) choose(side, false);
    return;
  }
}

const toScreen = (x, z) => [500 + x / VIEW * 1000, 215 - z / VIEW * 1000];
const ink = () => getComputedStyle(document.body).color;
// An empty picture in the page's ink.
function clear(id) {
  const pen = $(id).getContext("2d");
  pen.clearRect(0, 0, 1000, $(id).height);
  pen.strokeStyle = pen.fillStyle = ink();
  pen.lineWidth = 1;
  pen.font = "12px system-ui";
  return pen;
}
function drawHand(pen, hx, y) { pen.beginPath(); pen.arc(hx, y, 16, 0, 7); pen.stroke(); }
function draw() {
  const pen = clear("scene"), hx = 500 + 500 * place;
  pen.lineWidth = 2;
  if (answer) { // nothing but the hand: the tip, its spring and the block would tell the answer
    pen.fillText("blind", 485, 60);
    drawHand(pen, hx, 150);
    return;
  }
  pen.fillStyle = "#9aa7b2";
  pen.beginPath();
  pen.moveTo(0, 300);
  for (const [x, z] of stimulus.variants[+$("variant").value || 0].profile) pen.lineTo(...toScreen(x, z));
  pen.lineTo(1000, 300);
  pen.fill();
  pen.fillStyle = ink();
  const bar = 100e-6 / VIEW * 1000; // a scale bar, of widths and heights alike
  pen.fillRect(20, 278, bar, 4);
  pen.fillText("100 µm", 24 + bar, 285);
  const [px, pz] = toScreen(probe.x, probe.height()), r = radius() / VIEW * 1000;
  pen.strokeStyle = "#d07000";
  pen.beginPath();
  for (let i = 0; i <= 60; i++) pen.lineTo(px + (hx - px) * i / 60, pz + (i % 60 ? 10 * Math.sin(i * Math.PI / 2) : 0));
  pen.stroke();
  pen.fillStyle = "#556270";
  pen.beginPath();
  pen.arc(px, pz, r, 0, 7);
  pen.fill();
  drawHand(pen, hx, pz);
  pen.fillStyle = r > 40 ? "#fff" : ink();
  pen.fillText(`R ${short(radius() * 1e6)} µm`, px - 28, r > 40 ? pz + 4 : pz - r - 8);
}
// A curve with ticks and units on both axes.
function curve(id, values, from, to, unit) {
  const pen = clear(id), high = pen.canvas.height - 34, top = Math.max(0.1, ...values.map(Math.abs));
  const x = t => 60 + (t - from) / (to - from) * 930, y = f => 8 + high / 2 - f / top * high / 2;
  pen.globalAlpha = 0.25;
  for (const f of [-1, -0.5, 0, 0.5, 1]) { pen.fillRect(60, y(f * top), 930, 1); }
  pen.globalAlpha = 1;
  for (const f of [-1, 0, 1]) pen.fillText(`${(f * top).toFixed(2)} N`, 4, y(f * top) + 4);
  const parts = to - from > 100 ? 10 : 8;
  for (let n = 0; n <= parts; n++) { const t = from + (to - from) * n / parts; pen.fillText(`${+t.toFixed(3)} ${unit}`, Math.min(x(t), 950), high + 26); pen.fillRect(x(t), high + 8, 1, 5); }
  pen.beginPath();
  const step = Math.max(1, Math.floor(values.length / 1800));
  for (let i = 0; i < values.length; i += step) pen.lineTo(x(from + (to - from) * i / values.length), y(values[i]));
  pen.stroke();
  return pen;
}
// Energy of a stretch of force by frequency, 0 to 600 Hz in steps of 5 Hz; its mean and slope taken off.
function spectrumOf(force) {
  const n = force.length, middle = (n - 1) / 2;
  let mean = 0, slope = 0, square = 0;
  force.forEach((f, i) => { mean += f / n; slope += f * (i - middle); square += (i - middle) ** 2; });
  slope /= square;
  const flat = force.map((f, i) => f - mean - slope * (i - middle)), bars = [];
  for (let f = 0; f <= 600; f += 5) {
    let a = 0, b = 0;
    for (let i = 0; i < n; i += 2) { const t = 2 * Math.PI * f * i / RATE; a += flat[i] * Math.cos(t); b += flat[i] * Math.sin(t); }
    bars.push(a * a + b * b);
  }
  return bars;
}
const share = (bars, low, high) => bars.reduce((sum, bar, i) => sum + (i * 5 >= low && i * 5 <= high ? bar : 0), 0) / (bars.reduce((a, b) => a + b, 0) || 1);
// The two phases of the last release beside each other, each as a share of its own energy, as figure 5.
function drawSpectrum() {
  const map = clear("spectrum"), low = tool.frequency - 50, high = tool.frequency + 50;
  const loading = spectrumOf(Array.from(kept.before)), ringing = spectrumOf(Array.from(kept.ring)), x = f => 40 + f * 1.55;
  map.fillStyle = "#d0700033";
  map.fillRect(x(low), 0, x(high) - x(low), 140);
  for (const [bars, style, shift] of [[loading, "#3a6ea5", -3], [ringing, "#d07000", 0]]) {
    const most = Math.max(...bars) || 1;
    map.fillStyle = style;
    bars.forEach((bar, i) => map.fillRect(x(i * 5) + shift, 137 - bar / most * 130, 3, bar / most * 130 + 1));
  }
  map.fillStyle = ink();
  for (let f = 0; f <= 600; f += 50) map.fillText(`${f} Hz`, x(f) - 12, 156);
  const percent = value => `${Math.round(100 * value)} %`;
  $("shares").textContent = `loading: ${percent(share(loading, 0, 100))} below 100 Hz; ring: ${percent(share(ringing, low, high))} from ${Math.round(low)} to ${Math.round(high)} Hz`;
}
function plot() {
  if (answer) return;
  curve("force", history, -500, 0, "ms");
  if (since >= AFTER * RATE && !$("freeze").checked) {
    const at = history.length - since;
    kept = { force: history.slice(at - BEFORE * RATE, at + AFTER * RATE), before: history.slice(Math.max(at - 0.2 * RATE, 0), at - 5), ring: history.slice(at + 1, at + AFTER * RATE), released: Math.abs(probe.released) };
    since = -1;
    drawSpectrum();
  }
  if (kept) curve("zoom", kept.force, -BEFORE * 1e3, AFTER * 1e3, "ms").fillText(`released at ${kept.released.toFixed(3)} N, E_v ${energy(kept.released)}`, 620, 20);
}
function energy(force) { const E = releaseEnergy(force, tool); return E < 1e-3 ? `${(E * 1e6).toPrecision(3)} µJ` : `${(E * 1e3).toPrecision(3)} mJ`; }

// What the user does, tick by tick, as CSV that `stepblocks compare` reads.
function startRecord() {
  const file = `feel-${stimulus.name}.csv`, at = `--load "${tool.load} N" --friction ${tool.friction} --tip-radius "${micro(radius())} um"`;
  named = { file, command: `stepblocks compare ${file} --to "${stimulus.file}/${stimulus.name}" ${at}` };
  record = [];
  recorded = null;
  $("record").textContent = "stop and save";
}
function stopRecord() {
  recorded = record;
  record = null;
  $("record").textContent = "record";
  if (!recorded.length) return;
  const rows = recorded.map((row, i) => [(i / RATE).toFixed(4), ...row.map(value => +value.toPrecision(9))].join(","));
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob(["time_s,hand_m,tip_m,force_n,ring_n,releases\n" + rows.join("\n") + "\n"], { type: "text/csv" }));
  link.download = named.file;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  $("compare").textContent = named.command;
}

const WHY = { locked: "self-locked here: no pull lifts the probe over this edge", "too-high": "the ball meets the wall: no pull lifts it", "no-catch": "nothing catches in this direction" };
function describe() {
  const found = release(), releases = found.status === "releases", state = $("state");
  state.className = releases || found.status === "no-catch" ? "" : "locked";
  const beyond = `slips at ${found.force.toFixed(3)} N, beyond what ${stimulus.limiter} (${tool.limit} N): it does not slip`;
  const said = releases ? `slips at ${found.force.toFixed(3)} N` : WHY[found.status] ?? beyond;
  const lastly = probe.events ? `; last release at ${Math.abs(probe.released).toFixed(3)} N, E_v ${energy(probe.released)}` : "";
  state.textContent = `Pull ${probe.pull.toFixed(3)} N; ${said}${lastly}`;
}
let frame = 0;
function animate(now) {
  const ticks = last === null ? 0 : Math.min(Math.round((now - last) * RATE / 1000), RATE / 10);
  last = now;
  readPad(ticks / RATE);
  const from = hand, forces = [];
  let at = null;
  for (let n = 1; n <= ticks; n++) {
    hand = from + (wanted - from) * n / ticks;
    forces.push(probe.tick(hand, 1 / RATE));
    if (record) record.push([hand, probe.x, forces[n - 1], probe.ring, probe.events]);
    if (probe.events > heard) { heard = probe.events; at = n; if (tool.vibration) { sound(Math.abs(probe.released)); vibrate(Math.abs(probe.released)); } }
  }
  if (record && record.length >= LONGEST * RATE) stopRecord();
  history.copyWithin(0, ticks);
  history.set(forces, history.length - ticks);
  if (at !== null) since = ticks - at; else if (since >= 0) since += ticks;
  if (answer) { $("state").className = ""; $("state").textContent = "Feel A and B, then say which catches more"; } else describe();
  draw();
  if (frame++ % 6 === 0) plot();
  requestAnimationFrame(animate);
}
function toPlace(event) { const box = $("scene").getBoundingClientRect(); return 2 * (event.clientX - box.left) / box.width - 1; }
$("scene").addEventListener("pointerdown", event => { grabbed = true; move(toPlace(event)); $("scene").setPointerCapture(event.pointerId); });
$("scene").addEventListener("pointermove", event => { if (grabbed) move(toPlace(event)); });
$("scene").addEventListener("pointerup", () => { grabbed = false; });
document.addEventListener("keydown", event => {
  if (/SELECT|INPUT/.test(event.target.tagName) && event.target.type !== "checkbox") return;
  const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (way) { move(place + way * (event.shiftKey ? 0.002 : 0.02)); event.preventDefault(); }
  if (/^[aA]$/.test(event.key)) choose("block");
  if (/^[bB]$/.test(event.key)) choose("other");
  if (event.key === "0") choose(side, false);
});
for (const id of ["block", "other"]) $(id).addEventListener("change", () => choose(id));
for (const id of ["tip", "variant"]) $(id).addEventListener("change", () => { if (radius() >= 1e-6 && radius() <= 1e-3) restart(); });
$("a").addEventListener("click", () => choose("block"));
$("b").addEventListener("click", () => choose("other"));
$("blind").addEventListener("change", blind);
$("say-a").addEventListener("click", () => say(0));
$("say-b").addEventListener("click", () => say(1));
$("record").addEventListener("click", () => record ? stopRecord() : startRecord());
// what a file declares acts as it stands; a slider that is moved stops at thousandths
for (const id of ["load", "friction"]) $(id).addEventListener("input", () => { $(id).value = Math.round(1000 * $(id).value) / 1000; retune(); });
$("ring").addEventListener("input", retune);
choose("block");
requestAnimationFrame(animate);
