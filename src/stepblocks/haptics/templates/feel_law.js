"use strict";
// The law of libstepblocks in the browser: path of the ball's centre, prediction, and one tick of a
// tip that is pulled along x under a constant load. Lengths in m, forces in N, times in s. Held to
// the C library to 1e-6 by tests/simulators/test_feel_law.py.

const ANGLE_STEP = 2e-3;
const MOST_KNOTS = 20000;
const STEEPEST = 1e9;
const KINK = 1e-3;
const SAME = 1e-15;
const CATCH = 1e-6;
const FARTHEST = 1e3; // a place beyond is no number of a hand [m]
const SHORTEST = 1e-3; // time in which a hand may move where its clock says less [s]
const JUMP = 10; // a hand that is faster between two ticks jumped [m/s]
const FADE = 0.01; // in which the force vanishes after a fault, and comes back [s]

function clamp(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

// Circles about the discs, grown by the ball, and the lines, lifted by it.
function makeShapes(outline, radius) {
  const circles = outline.discs.map(([x, z, r]) => ({ x, z, r: r + radius }));
  const lines = outline.lines.map(([x0, z0, x1, z1]) => {
    const slope = (z1 - z0) / (x1 - x0);
    const length = Math.hypot(1, slope);
    const shift = (-radius * slope) / length;
    return { from: x0 + shift, to: x1 + shift, z: z0 + radius / length, slope };
  });
  return [...circles, ...lines];
}

function heightOf(shape, x) {
  if (shape.r !== undefined) {
    const across = shape.r * shape.r - (x - shape.x) * (x - shape.x);
    return across >= 0 ? shape.z + Math.sqrt(across) : -Infinity;
  }
  return x < shape.from - SAME || x > shape.to + SAME
    ? -Infinity
    : shape.z + shape.slope * (x - shape.from);
}

function slopeOf(shape, x) {
  if (shape.r === undefined) {
    return shape.slope;
  }
  const run = shape.x - x;
  const across = shape.r * shape.r - run * run;
  return across > 0
    ? clamp(run / Math.sqrt(across), -STEEPEST, STEEPEST)
    : Math.sign(run) * STEEPEST;
}

function topAt(shapes, x) {
  let best = shapes[0];
  let top = -Infinity;
  for (const shape of shapes) {
    const here = heightOf(shape, x);
    if (here > top) {
      top = here;
      best = shape;
    }
  }
  return best;
}

function findCrossing(a, b, low, high) {
  const difference = x => {
    const one = heightOf(a, x);
    const two = heightOf(b, x);
    if (isFinite(one) && isFinite(two)) {
      return one - two;
    }
    return one < 0 ? -1 : 1;
  };
  const atLow = difference(low);
  if (atLow * difference(high) >= 0) {
    return low;
  }
  for (let step = 0; step < 200; step++) {
    const middle = 0.5 * (low + high);
    if (middle <= low || middle >= high) {
      break;
    }
    if (atLow * difference(middle) > 0) {
      low = middle;
    } else {
      high = middle;
    }
  }
  return 0.5 * (low + high);
}

// Values in ascending order without those closer than a distance to the one before.
function sortUnique(values, apart) {
  const sorted = Float64Array.from(values).sort();
  return Array.from(sorted).filter((value, i) => i === 0 || value - sorted[i - 1] > apart);
}

// The path of the ball's centre: knots, and slopes at both ends of every piece.
function buildPath(outline, radius) {
  const shapes = makeShapes(outline, radius);
  const start = outline.lines[0][0];
  const end = outline.lines[outline.lines.length - 1][2];
  const most = Math.floor(MOST_KNOTS / Math.max(outline.discs.length, 1));
  const around = Math.max(16, Math.min(Math.ceil(Math.PI / ANGLE_STEP), most));
  let x = [start, end];
  for (const shape of shapes) {
    if (shape.r === undefined) {
      x.push(clamp(shape.from, start, end), clamp(shape.to, start, end));
    } else {
      for (let k = 0; k < around; k++) {
        const angle = -Math.PI / 2 + (Math.PI * k) / (around - 1);
        x.push(clamp(shape.x + shape.r * Math.sin(angle), start, end));
      }
    }
  }
  x = sortUnique(x, 0);
  for (let pass = 0; pass < 3; pass++) {
    const found = [];
    let middle = 0.5 * (x[0] + x[1]);
    let top = topAt(shapes, middle);
    for (let i = 1; i + 1 < x.length; i++) {
      const next = 0.5 * (x[i] + x[i + 1]);
      const after = topAt(shapes, next);
      if (after !== top) {
        found.push(findCrossing(top, after, middle, next));
      }
      middle = next;
      top = after;
    }
    const merged = sortUnique([...x, ...found], SAME);
    const same = merged.length === x.length;
    x = merged;
    if (same) {
      break;
    }
  }
  const z = x.map(place => heightOf(topAt(shapes, place), place));
  const first = [];
  const last = [];
  for (let i = 0; i + 1 < x.length; i++) {
    const top = topAt(shapes, 0.5 * (x[i] + x[i + 1]));
    first.push(slopeOf(top, x[i]));
    last.push(slopeOf(top, x[i + 1]));
  }
  const count = x.length;
  const up = [];
  const down = [];
  for (let i = 0; i < count; i++) {
    const before = i ? last[i - 1] : first[0];
    const after = i + 1 < count ? first[i] : last[count - 2];
    up.push(after - before > KINK && after > KINK);
    down.push(after - before > KINK && before < -KINK);
  }
  return { x, z, first, last, up, down };
}

// Equations (1) and (2): where, at which force and with which energy a drag towards +x or -x
// releases.
function predict(path, direction, tool) {
  const rises = direction > 0 ? path.first : path.last.map(slope => -slope);
  let best = 0;
  rises.forEach((rise, i) => {
    if (rise > rises[best]) {
      best = i;
    }
  });
  const knot = direction > 0 ? best : best + 1;
  const rise = rises[best];
  const found = { x: path.x[knot], z: path.z[knot], force: NaN, energy: NaN };
  found.angle = rise >= STEEPEST ? Math.PI / 2 : Math.atan(Math.max(rise, 0));
  const leant = found.angle + Math.atan(tool.friction);
  if (found.angle <= CATCH) {
    return { ...found, angle: 0, status: "no-catch" };
  }
  if (rise >= STEEPEST) {
    return { ...found, status: "too-high" };
  }
  if (leant >= Math.PI / 2) {
    return { ...found, status: "locked" };
  }
  found.force = tool.load * Math.tan(leant);
  if (found.force > tool.limit) {
    return { ...found, status: "beyond" };
  }
  return { ...found, energy: releaseEnergy(found.force, tool), status: "releases" };
}

// Energy of the ring [J]: the share C_v of what the spring holds.
function releaseEnergy(force, tool) {
  return (0.5 * tool.conversion * force * force) / tool.stiffness;
}

// The tip on its path, pulled through the spring. `tool` holds load, friction, stiffness,
// conversion, frequency, decay, limit and vibration; it may change between ticks.
class Probe {
  constructor(path, tool) {
    Object.assign(this, { path, tool, faults: 0 });
    this.place(path.x[0]);
  }

  place(x) {
    const xs = this.path.x;
    const last = xs.length - 1;
    this.x = clamp(x, xs[0], xs[last]);
    let low = 0;
    let high = last;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.x < xs[middle]) {
        high = middle;
      } else {
        low = middle;
      }
    }
    Object.assign(this, {
      piece: low,
      pull: 0,
      ring: 0,
      time: -1,
      strength: 0,
      events: 0,
      released: 0,
      begun: false,
      share: 1, // of the force that is given, below 1 after a fault
      good: 0, // last force that was meant [N]
    });
  }

  slope(i, x) {
    const { x: xs, first, last } = this.path;
    return first[i] + ((x - xs[i]) / (xs[i + 1] - xs[i])) * (last[i] - first[i]);
  }

  height(x = this.x) {
    const { x: xs, z: zs } = this.path;
    const i = this.piece;
    return zs[i] + ((zs[i + 1] - zs[i]) * (x - xs[i])) / (xs[i + 1] - xs[i]);
  }

  // Force left to move the tip in a direction, times the cosine of the slope.
  drive(direction, x, slope, hand) {
    const { stiffness, friction, load, limit } = this.tool;
    const rise = direction * slope;
    const along = Math.min(direction * stiffness * (hand - x), limit);
    return along * (1 - friction * rise) - load * (rise + friction);
  }

  // The tip leaves a knot: a release where the knot is a notch that held it. The hand went
  // straight from where it was a tick ago, and the force left to move the tip is linear along that
  // way: where it crosses zero the notch gave way, whatever the rate and the speed.
  leave(direction, knot, slope, hand, dt) {
    const { x: xs, up, down } = this.path;
    const { stiffness, friction, load, limit, conversion, vibration } = this.tool;
    if (!(direction > 0 ? up[knot] : down[knot])) {
      return;
    }
    const x = xs[knot];
    const rise = direction * slope;
    const need = load * (rise + friction);
    const from = direction * stiffness * (this.hand - x);
    const to = direction * stiffness * (hand - x);
    const before = from * (1 - friction * rise) - need;
    const after = to * (1 - friction * rise) - need;
    if (before > 0 && x !== this.x) {
      return; // passed without being held
    }
    const share = before < 0 && after > before ? Math.min(before / (before - after), 1) : 0;
    this.events++;
    this.released = direction * clamp(from + share * (to - from), -limit, limit);
    if (vibration) {
      this.time = (1 - share) * dt;
      this.strength = Math.sqrt(conversion) * this.released;
    }
  }

  slide(direction, hand, from, dt) {
    const { x: xs, first, last } = this.path;
    let x = this.x;
    let i = from;
    while (this.drive(direction, x, this.slope(i, x), hand) > 0) {
      const start = direction > 0 ? i : i + 1;
      if (this.begun && x === xs[start]) {
        this.leave(direction, start, direction > 0 ? first[i] : last[i], hand, dt);
      }
      let far = direction > 0 ? xs[i + 1] : xs[i];
      if (this.drive(direction, far, direction > 0 ? last[i] : first[i], hand) > 0) {
        x = far;
        if (i + direction < 0 || i + direction > xs.length - 2) {
          break;
        }
        i += direction;
        continue;
      }
      for (let n = 0; n < 40; n++) {
        const middle = 0.5 * (x + far);
        if (this.drive(direction, middle, this.slope(i, middle), hand) > 0) {
          x = middle;
        } else {
          far = middle;
        }
      }
      break;
    }
    return [x, i];
  }

  // One tick with the hand at a place; returns the force on the hand. A place that is no number,
  // and a time that runs backwards, are counted and move nothing: the last good force fades to zero
  // within FADE, and grows again as slowly afterwards. A hand that jumped sets the tip down anew.
  tick(hand, dt) {
    const share = this.share;
    if (!(Math.abs(hand) <= FARTHEST && dt >= 0 && dt <= FARTHEST)) {
      this.faults++;
      this.share = Math.max(share - (dt > 0 && dt < SHORTEST ? dt : SHORTEST) / FADE, 0);
      return share * this.good;
    }
    if (this.begun && Math.abs(hand - this.seen) > JUMP * Math.max(dt, SHORTEST)) {
      this.begun = false;
      this.share = 0;
      this.time = -1;
    }
    this.seen = hand;
    this.good = this.move(hand, dt);
    const given = this.share * this.good;
    this.share = Math.min(this.share + dt / FADE, 1);
    return given;
  }

  move(hand, dt) {
    const { x: xs } = this.path;
    const { stiffness, limit, frequency, decay } = this.tool;
    hand = clamp(hand, xs[0], xs[xs.length - 1]);
    if (!this.begun) {
      const { events, released, share, time, strength } = this;
      this.place(hand);
      Object.assign(this, { events, released, share, time, strength, hand });
    }
    const before = this.x;
    const i = this.piece;
    const atStart = before === xs[i];
    const atEnd = before === xs[i + 1];
    let moved = this.slide(1, hand, atEnd && i + 2 < xs.length ? i + 1 : i, dt);
    if (moved[0] === before) {
      moved = this.slide(-1, hand, atStart && i > 0 ? i - 1 : i, dt);
    }
    if (moved[0] !== before) {
      [this.x, this.piece] = moved;
    }
    this.begun = true;
    this.hand = hand;
    this.pull = clamp(stiffness * (hand - this.x), -limit, limit);
    this.ring = 0;
    if (this.time >= 0) {
      this.ring =
        this.strength *
        Math.exp(-this.time / decay) *
        Math.sin(2 * Math.PI * frequency * this.time);
      this.time += dt;
    }
    return this.ring - this.pull;
  }
}
