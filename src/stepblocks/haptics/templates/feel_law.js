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
    Object.assign(this, { path, tool });
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

  slide(direction, hand, from) {
    const { x: xs, first, last } = this.path;
    let x = this.x;
    let i = from;
    while (this.drive(direction, x, this.slope(i, x), hand) > 0) {
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

  // One tick with the hand at a place; returns the force on the hand.
  tick(hand, dt) {
    const { x: xs, up, down } = this.path;
    const { stiffness, limit, conversion, frequency, decay, vibration } = this.tool;
    hand = clamp(hand, xs[0], xs[xs.length - 1]);
    if (!this.begun) {
      const { events, released } = this;
      this.place(hand);
      Object.assign(this, { events, released });
    }
    const before = this.x;
    const i = this.piece;
    const atStart = before === xs[i];
    const atEnd = before === xs[i + 1];
    let caught = up;
    let moved = this.slide(1, hand, atEnd && i + 2 < xs.length ? i + 1 : i);
    if (moved[0] === before) {
      caught = down;
      moved = this.slide(-1, hand, atStart && i > 0 ? i - 1 : i);
    }
    if (moved[0] !== before) {
      [this.x, this.piece] = moved;
      if (this.begun && ((atStart && caught[i]) || (atEnd && caught[i + 1]))) {
        this.events++;
        this.released = this.pull;
        if (vibration) {
          this.time = 0;
          this.strength = Math.sqrt(conversion) * this.pull;
        }
      }
    }
    this.begun = true;
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
