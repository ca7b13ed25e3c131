// ---- what is drawn ---------------------------------------------------------------------------

const omegaOf = s => s.l.map((x, k) => x / state.body.moments[k]);
function eulerOf(s) {   // z-x-z: axis 3 of the body in space has the polar angles theta and phi - 90 degrees
  if (!s.euler) { const a = matrix(s.q); s.euler = [Math.atan2(a[0][2], -a[1][2]), Math.acos(clamp(a[2][2], -1, 1)), Math.atan2(a[2][0], a[2][1])]; }
  return s.euler;
}
function thetaRate(s) { const [w1, w2] = omegaOf(s), psi = eulerOf(s)[2]; return w1 * Math.cos(psi) - w2 * Math.sin(psi); }
const QUANTITIES = {
  omega: ["angular velocity, body axes", "ω [rad/s]", ["ω₁", "ω₂", "ω₃"], omegaOf],
  theta: ["nutation angle θ of axis 3", "θ [degrees]", ["θ"], s => [degrees(eulerOf(s)[1])]],
  euler: ["Euler angles z-x-z without mean rates", "angle [degrees]", ["φ", "θ", "ψ"], s => eulerOf(s).map(degrees)],
  direction: ["direction of L, body axes", "L/|L|", ["1", "2", "3"], s => sized(s.l, 1)],
};
const PHASES = {
  omega12: ["ω₁ and ω₂", "ω₁ [rad/s]", "ω₂ [rad/s]", s => omegaOf(s).slice(0, 2)],
  omega23: ["ω₂ and ω₃", "ω₂ [rad/s]", "ω₃ [rad/s]", s => omegaOf(s).slice(1)],
  omega13: ["ω₁ and ω₃", "ω₁ [rad/s]", "ω₃ [rad/s]", s => [omegaOf(s)[0], omegaOf(s)[2]]],
  theta: ["θ and its rate", "θ [degrees]", "dθ/dt [degrees/s]", s => [degrees(eulerOf(s)[1]), degrees(thetaRate(s))]],
};
const SPACE = { body: "body in space", poinsot: "Poinsot's ellipsoid on the invariable plane" };
const INSIDE = { momentum: "momentum sphere", ellipsoid: "polhode on the inertia ellipsoid" };
// times of days on the screen where the scene lasts for days
const CLOCK = DATA.end > 1e5 ? { by: 86400, unit: "days", one: "day" } : { by: 1, unit: "s", one: "s" };
let stages, charts;

// triangles of the unit ball
const BALL = (() => {
  const list = [], at = (i, j) => { const a = Math.PI * i / 18, b = 2 * Math.PI * j / 36; return [Math.sin(a) * Math.cos(b), Math.sin(a) * Math.sin(b), Math.cos(a)]; };
  for (let i = 0; i < 18; i++) for (let j = 0; j < 36; j++) {
    const [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
    if (i < 17) list.push(...a, ...b, ...c);
    if (i > 0) list.push(...a, ...c, ...d);
  }
  return list;
})();
// tones of the ball's triangles, by octants, so that a spin is seen
const ballTones = () => Array.from({ length: BALL.length / 9 }, (_, k) => {
  const p = [0, 1, 2].map(i => BALL[9 * k + i] + BALL[9 * k + 3 + i] + BALL[9 * k + 6 + i]);
  return DATA.tones[p[0] * p[1] * p[2] > 0 ? 0 : 1];
});
const SHAPE = { corners: new Float32Array(bytes(DATA.shape.corners).buffer), tones: DATA.shape.faces.map(tone => DATA.tones[tone]) };
const UNIT = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];
const stretched = ([a, b, c], [x, y, z] = [0, 0, 0]) => [a, 0, 0, x, 0, b, 0, y, 0, 0, c, z];
// the ellipsoid of uniform density with these moments, as large as the picture; the shape itself until its moments change
function form() {
  const { moments: i, mass, centre: c } = state.body, isOwn = !SLIDERS.some(s => isMoved(s) && ["moments", "mass", "centre"].includes(s.kind));
  if (isOwn) return { corners: SHAPE.corners, tones: SHAPE.tones, form: DATA.shape.form };
  const own = i.map((x, k) => x - mass * (inner(c, c) - c[k] * c[k])), sum = own[0] + own[1] + own[2];
  const axes = own.map(x => Math.sqrt(Math.max(2.5 * (sum - 2 * x) / mass, 0))), thick = axes.map(a => Math.max(a, 0.03 * Math.max(...axes)));
  const scale = 1 / Math.max(...thick.map((a, k) => Math.hypot(...c.map((x, n) => n === k ? Math.abs(x) + a : x))));
  return { corners: BALL, tones: ballTones(), form: stretched(thick.map(a => scale * a), c.map(x => scale * x)) };
}


const RODS = 100;   // most other members whose axis 3 is drawn as a line, not only as its tip
function drawInSpace(stage, s) {
  const turn = matrix(s.q), trace = [];
  for (const one of state.trail) {   // 0.015 rad apart, for a trace of many nutations
    const tip = matrix(one.q).map(row => row[2]);
    if (!trace.length || one === s || size(sub(tip, trace.at(-1))) > 0.015) trace.push(tip);
  }
  const isOn = id => $(`arrow-${id}`).checked, arrow = (v, most) => v.map(x => 1.1 * x / (most || 1));
  const arrows = [["ω", isOn("omega") && arrow(times(turn, omegaOf(s)), state.most.omega), "--weight"],
    // 1e-9 of the rate of a free L: the rounding of a torque that is 0
    ["τ", isOn("torque") && state.most.torque > 1e-9 * size(s.l) * state.rate && arrow(s.torque, state.most.torque), "--torque"]].filter(([, v]) => v);
  drawBody(stage, { turn, ...form(), l: isOn("momentum") ? sized(times(turn, s.l), 1) : [0, 0, 0], trace: trace.slice(-TRACE), pulls: DATA.pulls, arrows });
  for (let m = 1; state.others && m < state.members; m++) {
    const tip = matrix([0, 1, 2, 3].map(i => state.others[i * state.members + m])).map(row => 1.2 * row[2]);
    if (state.members <= RODS) stage.segment([0, 0, 0], tip, colour("--rule"), 1.2, 4);
    stage.dot(tip, colour("--one"), state.members > 200 ? 1.3 : 2.2);
  }
  $("space-words").textContent = `Orange: ${isOn("momentum") ? "angular momentum L, and the " : ""}trace of axis 3.`
    + `${arrows.length ? ` Lengths of ${arrows.map(([name]) => name).join(", ")}: relative to the largest so far.` : ""}${state.others ? " Blue: axis 3 of the other members." : ""}`;
}
// the inertia ellipsoid of rho = omega/sqrt(2T), its touching point and plane, scaled to the stage
function poinsot(s) {
  const w = omegaOf(s), energy = inner(w, s.l) / 2, axes = state.body.moments.map(i => 1 / Math.sqrt(i));
  const scale = 1.1 / Math.max(...axes), rho = w.map(x => scale * x / Math.sqrt(2 * energy || 1));
  return { rho, axes: axes.map(a => scale * a), height: scale * Math.sqrt(2 * energy) / (size(s.l) || 1) };
}
function drawPoinsot(stage, s) {
  const turn = matrix(s.q), { rho, axes, height } = poinsot(s), up = sized(times(turn, s.l), 1), path = colour("--path");
  // the page shows L upward: a rotation that takes it there
  const e = Math.abs(up[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0], one = sized(sub(e, up.map(x => x * inner(e, up))), 1), rows = [one, cross(up, one), up];
  const shown = m => rows.map(row => [0, 1, 2].map(k => row[0] * m[0][k] + row[1] * m[1][k] + row[2] * m[2][k]));
  const here = shown(turn), grid = colour("--rule");
  for (let k = -4; k <= 4; k++) for (const swap of [false, true]) {
    const far = Math.sqrt(Math.max(0, 2.25 - 0.140625 * k * k)), at = x => swap ? [0.375 * k, x, height] : [x, 0.375 * k, height];
    stage.curve([at(-far), at(far)], grid, 1);
  }
  stage.curve(Array.from({ length: 91 }, (_, n) => [1.5 * Math.cos(n * Math.PI / 45), 1.5 * Math.sin(n * Math.PI / 45), height]), grid, 1.2);
  stage.solid(BALL, ballTones(), stretched(axes), here);
  const recent = state.trail.slice(-TRACE).map(one => [one, poinsot(one).rho]);
  stage.curve(recent.map(([, r]) => times(here, r).map(x => 1.01 * x)), colour("--three"), 2, null, 0.1);
  stage.curve(recent.map(([one, r]) => times(shown(matrix(one.q)), r)).map(p => [p[0], p[1], height + 0.01]), path, 2, null, 0.1);
  stage.arrow([0, 0, height], [0, 0, height + 0.5], path);
  stage.label("L", [0, 0, height + 0.62], path);
  stage.arrow([0, 0, 0], times(here, rho), colour("--weight"), 2.5);
  stage.label("ω", times(here, rho).map(x => 1.12 * x), colour("--weight"));
  $("space-words").textContent = DATA.isFree ? "Grey: polhode on the ellipsoid. Orange: herpolhode on the plane."
    : "Grey: polhode. Orange: herpolhode. With a torque the plane moves.";
}
function drawMomentum(stage, s) {
  const others = [];
  for (let m = 1; state.others && m < state.members; m++) others.push(sized([4, 5, 6].map(i => state.others[i * state.members + m]), 1));
  drawSphere(stage, { moments: state.body.moments, u: sized(s.l, 1), path: state.trail.map(one => sized(one.l, 1)), others });
  $("inside-words").textContent = `L in the principal axes. Thin lines: polhodes${DATA.isFree ? "" : " without torque"}; ${thickCurve(state.body.moments)}.`;
}
function drawEllipsoid(stage, s) {
  const still = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], { axes, rho } = poinsot(s), m = state.body.moments, path = colour("--path");
  // rho = I^-1 L / sqrt(2T): the curves of the momentum sphere, seen in rho
  const onSurface = u => { const w = u.map((x, k) => x / m[k]), n = Math.sqrt(inner(w, u)); return w.map(x => 1.01 * x / n * axes[0] * Math.sqrt(m[0])); };
  stage.solid(BALL, ballTones().map(t => t.map(x => 0.5 * x + 120)), stretched(axes), still);
  for (const curve of polhodes(m, levels(m))) stage.curve(curve.map(onSurface), colour("--grey"), 0.8, null, 0.08);
  for (const curve of polhodes(m, [separatrix(m)])) stage.curve(curve.map(onSurface), colour("--ink"), 1.4, null, 0.08);
  for (let a = 0; a < 3; a++) {
    const e = [0, 0, 0]; e[a] = 1.2;
    stage.segment([0, 0, 0], e, colour(AXIS[a]), 1.6);
    stage.label(`${a + 1}`, e.map(x => 1.08 * x), colour(AXIS[a]));
  }
  stage.curve(state.trail.map(one => poinsot(one).rho.map(x => 1.02 * x)), path, 2, null, 0.1);
  stage.dot(rho.map(x => 1.03 * x), path, 5, colour("--paper"));
  $("inside-words").textContent = "Angular velocity on the inertia ellipsoid. Orange: its polhode.";
}

const HANDS = matchMedia("(pointer: coarse)").matches ? "Two fingers turn and zoom a picture; one finger turns it sideways."
  : "Drag to turn, scroll to zoom. A slider is ten times finer with Shift; once Tab has reached it, the arrow keys move it.";
function draw() {
  // a frame that is not shown has no width
  if (!state.samples.length || !stages || !stages.body.node.clientWidth) return;
  const { s, k } = shown();
  state.past = state.samples.slice(0, k + 1);
  state.trail = $("trace").checked ? [...state.past, s] : [s];
  state.frames++;
  stages.body.begin(); stages.sphere.begin();
  ({ body: drawInSpace, poinsot: drawPoinsot })[$("space").value](stages.body, s);
  ({ momentum: drawMomentum, ellipsoid: drawEllipsoid })[$("inside").value](stages.sphere, s);
  stages.body.end(); stages.sphere.end();
  drawCharts();
  $("clock").textContent = `${(s.time / CLOCK.by).toPrecision(4)} ${CLOCK.unit}`;
  if (state.failed) return;
  const flagged = Object.entries(DATA.statuses).find(([, code]) => code === state.status);
  const words = (state.why && `${state.why} `) + (flagged[1] ? `Flagged: ${flagged[0].replaceAll("_", " ")}; the body stays at its last good state.`
    : `${DATA.integrator}, step ${nice(+state.h.toPrecision(4))} s, ${state.step.toLocaleString("en")} step${state.step === 1 ? "" : "s"}, computed in this page with the same `
      + `bits as the command line${state.fused ? "" : " (this machine has no fused multiply-add: slower)"}. ${HANDS}`);
  warn(words, state.why ? "No mass distribution" : flagged[1] ? "Flagged" : "");
}
// an angle [degrees] without jumps of whole turns, and its mean rate: over whole nutations, or, before there is one, by least
// squares with small weights at the ends, which are anywhere in a nutation, as in `rigidmc.views.closed_forms.mean_rate`
function unwrapped(y) {
  for (let i = 1; i < y.length; i++) y[i] -= 360 * Math.round((y[i] - y[i - 1]) / 360);
  return y;
}
function meanRate(t, y, peaks) {
  const n = t.length, span = t[n - 1] - t[0];
  if (peaks.length > 1) {
    const at = x => { const i = t.findIndex(one => one >= x); return y[i - 1] + (y[i] - y[i - 1]) * (x - t[i - 1]) / (t[i] - t[i - 1]); };
    return (at(peaks.at(-1)) - at(peaks[0])) / (peaks.at(-1) - peaks[0]);
  }
  if (!(span > 0)) return 0;
  const edge = 0.5 * span / (n - 1), weights = t.map(x => Math.sin(Math.PI * (x - t[0] + edge) / (span + 2 * edge)) ** 2);
  const middle = t.reduce((sum, x, i) => sum + weights[i] * x, 0) / weights.reduce((sum, x) => sum + x, 0);
  const over = v => t.reduce((sum, x, i) => sum + weights[i] * (x - middle) * v[i], 0);
  return over(y) / over(t);
}
function drawCharts() {
  const samples = state.past, t = samples.map(s => s.time / CLOCK.by), across = `time [${CLOCK.unit}]`;
  const [, upward, names, of] = QUANTITIES[$("quantity").value], found = samples.map(of), shown = [...names];
  const peaks = peaksOf(t, samples.map(s => degrees(eulerOf(s)[1])));
  const series = names.map((name, k) => ({ name, x: t, y: found.map(one => one[k]) }));
  if ($("quantity").value === "euler") for (const k of [0, 2]) {
    const { y } = series[k], rate = meanRate(t, unwrapped(y), peaks);
    series[k].y = y.map((x, i) => x - rate * (t[i] - t[0]));
    if (rate) shown[k] = series[k].name = `${names[k]} ${rate > 0 ? "−" : "+"} (${nice(+Math.abs(rate).toPrecision(4))}°/${CLOCK.one}) t`;
  }
  charts.motion.draw({ series, across, upward });
  legend("names", shown);
  const [, one, two, pair] = PHASES[$("phase").value], pairs = samples.map(pair);
  charts.portrait.draw({ series: [{ x: pairs.map(p => p[0]), y: pairs.map(p => p[1]) }], across: one, upward: two, dots: true });
  const words = DATA.conserved.map((kept, k) => ["energy", "|L|²"][k] + (kept ? "" : " (not conserved here)"));
  const log = k => ({ name: words[k], x: t, y: samples.map(s => Math.log10(Math.max(Math.abs(s.drift[k]), 1e-17))) });
  charts.drift.draw({ series: [log(0), log(1)], across, upward: "relative drift", log: true });
  legend("drifts", words);
  $("readings").replaceChildren(...readings(samples, t, peaks).map(([name, words]) => html("span", {}, `${name} ${words}`)));
}
