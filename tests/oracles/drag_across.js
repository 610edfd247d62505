// Drag the page's own probe over a stimulus slowly, under what its file declares, and report.
function dragAcross(index, changes = {}) {
  const one = STIMULI[index];
  const under = { ...one, vibration: true, ...changes };
  const path = buildPath(one.variants[0], under.radius);
  const probe = new Probe(path, under);
  const formula = predict(path, 1, under);
  const target = isFinite(formula.force) ? formula.force : 10 * under.load;
  const start = formula.x - 30e-6;
  const travel = 30e-6 + (1.2 * target) / under.stiffness;
  let peak = 0;
  probe.place(start);
  for (let s = 0; s < travel; s += (1e-3 * target) / under.stiffness) {
    probe.tick(start + s, 1 / RATE);
    peak = Math.max(peak, probe.pull);
  }
  return {
    peak,
    events: probe.events,
    status: formula.status,
    formula: isFinite(formula.force) ? formula.force : null,
  };
}
