// ---- what every page draws: the body in space, and the momentum sphere -------------------------

const AXIS = ["--one", "--two", "--three"];
const TRACE = 900;   // points of the trace of axis 3

// turn: rows of the body's rotation; axes: of its named axes, if these are others; l: the momentum, of length 1 or less;
// trace: unit vectors of axis 3; centre: of mass; pulls: [name, direction]; radius: unit vector of the local vertical;
// arrows: [name, vector in space, colour]
function drawBody(stage, { turn, axes = turn, corners, tones, form, l, trace, centre = null, pulls = [], radius = null, arrows = [] }) {
  const ink = colour("--grey"), path = colour("--path"), weight = colour("--weight");
  stage.segment([0, 0, -1.25], [0, 0, 1.25], ink, 1);
  stage.label("z", [0, 0, 1.36], ink);
  stage.solid(corners, tones, form, turn);
  for (let a = 0; a < 3; a++) {
    const end = axes.map(row => 1.2 * row[a]);
    stage.segment([0, 0, 0], end, colour(AXIS[a]), 1.6);
    stage.label(`${a + 1}`, end.map(x => 1.08 * x), colour(AXIS[a]));
  }
  if (centre) stage.segment([0, 0, 0], times(turn, centre), colour("--ink"), 2);
  stage.dot([0, 0, 0], colour("--ink"), 2.5);
  const tip = l.map(x => 1.15 * x);
  stage.arrow([0, 0, 0], tip, path);
  if (size(tip) > 0) stage.label("L", sized(tip, size(tip) + 0.3), path);
  for (const [name, v, style] of arrows) {
    stage.arrow([0, 0, 0], v, colour(style), 2.5);
    if (size(v) > 0) stage.label(name, sized(v, size(v) + 0.15), colour(style));
  }
  stage.curve(trace.map(e => e.map(x => 1.2 * x)), path, 1.4, x => 0.15 + 0.85 * x);
  for (const [name, along] of pulls) {
    const from = [1.05, 0, 0.75];
    stage.arrow(from, from.map((x, k) => x + 0.45 * along[k]), weight, 2);
    stage.label(name, from.map((x, k) => x + 0.6 * along[k]), weight);
  }
  if (radius) {
    stage.arrow([0, 0, 0], radius.map(x => 1.25 * x), weight, 2);
    stage.label("r", radius.map(x => 1.38 * x), weight);
  }
}

// polhodes on the unit momentum sphere: for energies e, u^2/I summed = e, by the angle around an outer axis
function polhodes(moments, energies) {
  const order = [0, 1, 2].sort((a, b) => moments[a] - moments[b]), curves = [];
  const inverse = moments.map(x => 1 / x), [low, middle, high] = order;
  for (const e of energies) for (const pole of e > inverse[middle] ? [low] : [high]) {
    const [i, j] = [0, 1, 2].filter(k => k !== pole);
    const a = (e - inverse[pole]) / (inverse[i] - inverse[pole]), b = (e - inverse[pole]) / (inverse[j] - inverse[pole]);
    if (!(a >= 0 && b >= 0)) continue;
    for (const side of [-1, 1]) curves.push(Array.from({ length: 145 }, (_, n) => {
      const f = 2 * Math.PI * n / 144, u = [0, 0, 0];
      u[i] = Math.sqrt(a) * Math.cos(f); u[j] = Math.sqrt(b) * Math.sin(f);
      u[pole] = side * Math.sqrt(Math.max(0, 1 - u[i] ** 2 - u[j] ** 2));
      return u;
    }));
  }
  return curves;
}
function levels(moments) {
  const inverse = moments.map(x => 1 / x).sort((a, b) => a - b), [least, mid, most] = inverse;
  const parts = [0.1, 0.35, 0.65, 0.9];
  return [...parts.map(p => least + p ** 2 * (mid - least)), ...parts.map(p => most - p ** 2 * (most - mid))];
}
// what the curve of `separatrix` is: with two equal moments a circle of fixed points
function thickCurve(moments) {
  const [least, mid, most] = [...moments].sort((a, b) => a - b), same = (a, b) => Math.abs(a - b) <= 1e-9 * most;
  if (same(least, most)) return "with three equal moments L stays anywhere";
  return same(least, mid) || same(mid, most) ? "thick: a circle of fixed points, for two moments are equal" : "thick: separatrix";
}
const separatrix = moments => 1 / [...moments].sort((a, b) => a - b)[1] * (1 + 1e-9);

// u: the direction of the momentum, and path: of directions, in principal axes; others: of other members
function drawSphere(stage, { moments, names = ["1", "2", "3"], u, path, others = [], density = null }) {
  const orange = colour("--path");
  stage.ball(density);
  for (const curve of polhodes(moments, levels(moments))) stage.onBall(curve, colour("--grey"), 0.8, 0.12);
  for (const curve of polhodes(moments, [separatrix(moments)])) stage.onBall(curve, colour("--ink"), 1.4);
  for (let a = 0; a < 3; a++) {
    const e = [0, 0, 0]; e[a] = 1.25;
    for (const side of [-1, 1]) {
      const end = e.map(x => side * x), start = end.map(x => x / 1.25);
      if (!stage.isHidden(end)) stage.segment(start, end, colour(AXIS[a]), 1.6);
    }
    stage.label(names[a], e.map(x => 1.1 * x), colour(AXIS[a]));
  }
  for (const p of others) if (!stage.isHidden(p)) stage.dot(p, colour("--one"), others.length > 200 ? 1.3 : 2.2);
  stage.onBall(path, orange, 1.8);
  stage.dot(u, orange, stage.isHidden(u) ? 3 : 6, colour("--paper"));
}
