// Pictures of the page: block, hand and tip, force over time, spectrum of the last release.
const toScreen = (x, z) => [500 + (x / VIEW) * 1000, 215 - (z / VIEW) * 1000];
const ink = () => getComputedStyle(document.body).color;
// An empty picture in the page's ink.
function clear(id) {
  const pen = $(id).getContext("2d");
  pen.clearRect(0, 0, 1000, $(id).height);
  pen.strokeStyle = ink();
  pen.fillStyle = ink();
  pen.lineWidth = 1;
  pen.font = "12px system-ui";
  return pen;
}

function drawHand(pen, handX, y) {
  pen.beginPath();
  pen.arc(handX, y, 16, 0, 7);
  pen.stroke();
}

function draw() {
  const pen = clear("scene");
  const handX = 500 + 500 * place;
  pen.lineWidth = 2;
  if (answer) {
    // nothing but the hand: the tip, its spring and the block would tell the answer
    pen.fillText("blind", 485, 60);
    drawHand(pen, handX, 150);
    return;
  }
  pen.fillStyle = "#9aa7b2";
  pen.beginPath();
  pen.moveTo(0, 300);
  for (const [x, z] of stimulus.variants[+$("variant").value || 0].profile) {
    pen.lineTo(...toScreen(x, z));
  }
  pen.lineTo(1000, 300);
  pen.fill();
  pen.fillStyle = ink();
  const bar = (100e-6 / VIEW) * 1000; // a scale bar, of widths and heights alike
  pen.fillRect(20, 278, bar, 4);
  pen.fillText("100 µm", 24 + bar, 285);
  const [tipX, tipZ] = toScreen(probe.x, probe.height());
  const r = (radius() / VIEW) * 1000;
  pen.strokeStyle = "#d07000";
  pen.beginPath();
  for (let i = 0; i <= 60; i++) {
    const coil = i % 60 ? 10 * Math.sin((i * Math.PI) / 2) : 0;
    pen.lineTo(tipX + ((handX - tipX) * i) / 60, tipZ + coil);
  }
  pen.stroke();
  pen.fillStyle = "#556270";
  pen.beginPath();
  pen.arc(tipX, tipZ, r, 0, 7);
  pen.fill();
  drawHand(pen, handX, tipZ);
  pen.fillStyle = r > 40 ? "#fff" : ink();
  const below = r > 40 ? 4 : -r - 8;
  pen.fillText(`R ${toFourDigits(radius() * 1e6)} µm`, tipX - 28, tipZ + below);
}

// A curve with ticks and units on both axes.
function curve(id, values, from, to, unit) {
  const pen = clear(id);
  const high = pen.canvas.height - 34;
  const top = Math.max(0.1, ...values.map(Math.abs));
  const x = t => 60 + ((t - from) / (to - from)) * 930;
  const y = f => 8 + high / 2 - ((f / top) * high) / 2;
  pen.globalAlpha = 0.25;
  for (const f of [-1, -0.5, 0, 0.5, 1]) {
    pen.fillRect(60, y(f * top), 930, 1);
  }
  pen.globalAlpha = 1;
  for (const f of [-1, 0, 1]) {
    pen.fillText(`${(f * top).toFixed(2)} N`, 4, y(f * top) + 4);
  }
  const parts = to - from > 100 ? 10 : 8;
  for (let n = 0; n <= parts; n++) {
    const t = from + ((to - from) * n) / parts;
    pen.fillText(`${+t.toFixed(3)} ${unit}`, Math.min(x(t), 950), high + 26);
    pen.fillRect(x(t), high + 8, 1, 5);
  }
  pen.beginPath();
  const step = Math.max(1, Math.floor(values.length / 1800));
  for (let i = 0; i < values.length; i += step) {
    pen.lineTo(x(from + ((to - from) * i) / values.length), y(values[i]));
  }
  pen.stroke();
  return pen;
}

// Energy of a stretch of force by frequency, 0 to 600 Hz in steps of 5 Hz; its mean and slope are
// taken off.
function spectrumOf(force) {
  const n = force.length;
  const middle = (n - 1) / 2;
  let mean = 0;
  let slope = 0;
  let square = 0;
  force.forEach((f, i) => {
    mean += f / n;
    slope += f * (i - middle);
    square += (i - middle) ** 2;
  });
  slope /= square;
  const flat = force.map((f, i) => f - mean - slope * (i - middle));
  const bars = [];
  for (let f = 0; f <= 600; f += 5) {
    let a = 0;
    let b = 0;
    for (let i = 0; i < n; i += 2) {
      const t = (2 * Math.PI * f * i) / RATE;
      a += flat[i] * Math.cos(t);
      b += flat[i] * Math.sin(t);
    }
    bars.push(a * a + b * b);
  }
  return bars;
}

// Share of the energy of a spectrum between two frequencies [Hz].
function share(bars, low, high) {
  const add = (sum, bar) => sum + bar;
  const within = bars.filter((_, i) => i * 5 >= low && i * 5 <= high).reduce(add, 0);
  const whole = bars.reduce(add, 0);
  return whole ? within / whole : 0;
}

// The two phases of the last release beside each other, each as a share of its own energy, as in
// figure 5.
function drawSpectrum() {
  const map = clear("spectrum");
  const low = tool.frequency - 50;
  const high = tool.frequency + 50;
  const loading = spectrumOf(Array.from(kept.before));
  const ringing = spectrumOf(Array.from(kept.ring));
  const x = f => 40 + f * 1.55;
  map.fillStyle = "#d0700033";
  map.fillRect(x(low), 0, x(high) - x(low), 140);
  for (const [bars, style, shift] of [
    [loading, "#3a6ea5", -3],
    [ringing, "#d07000", 0],
  ]) {
    const most = Math.max(...bars) || 1;
    map.fillStyle = style;
    bars.forEach((bar, i) =>
      map.fillRect(x(i * 5) + shift, 137 - (bar / most) * 130, 3, (bar / most) * 130 + 1),
    );
  }
  map.fillStyle = ink();
  for (let f = 0; f <= 600; f += 50) {
    map.fillText(`${f} Hz`, x(f) - 12, 156);
  }
  const percent = value => `${Math.round(100 * value)} %`;
  $("shares").textContent =
    `loading: ${percent(share(loading, 0, 100))} below 100 Hz; ` +
    `ring: ${percent(share(ringing, low, high))} ` +
    `from ${Math.round(low)} to ${Math.round(high)} Hz`;
}

function plot() {
  if (answer) {
    return;
  }
  curve("force", history, -500, 0, "ms");
  if (since >= AFTER * RATE && !$("freeze").checked) {
    const at = history.length - since;
    kept = {
      force: history.slice(at - BEFORE * RATE, at + AFTER * RATE),
      before: history.slice(Math.max(at - 0.2 * RATE, 0), at - 5),
      ring: history.slice(at + 1, at + AFTER * RATE),
      released: Math.abs(probe.released),
    };
    since = -1;
    drawSpectrum();
  }
  if (kept) {
    curve("zoom", kept.force, -BEFORE * 1e3, AFTER * 1e3, "ms").fillText(
      `released at ${kept.released.toFixed(3)} N, E_v ${energy(kept.released)}`,
      620,
      20,
    );
  }
}

function energy(force) {
  const E = releaseEnergy(force, tool);
  return E < 1e-3 ? `${(E * 1e6).toPrecision(3)} µJ` : `${(E * 1e3).toPrecision(3)} mJ`;
}
