// Drag the page's own probe over a block at 2 mm/s and report.
function dragAcross(index, load, friction) {
  const block = BLOCKS[index], probe = new Probe(block, load, friction, true), target = release(block, load, friction);
  const start = block.trigger - 30e-6, travel = 30e-6 + 1.2 * (isFinite(target) ? target : 10 * load) / K;
  let peak = 0;
  probe.place(start);
  for (let s = 0; s < travel; s += 2e-3 / RATE) { probe.tick(start + s); peak = Math.max(peak, probe.pull); }
  return { peak, events: probe.events, formula: isFinite(target) ? target : null };
}
