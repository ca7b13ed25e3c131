// ---- the start: rows of the members, as Python builds them -----------------------------------

const doubles = text => new Float64Array(bytes(text).buffer);
const { width: WIDTH, rows: AT } = DATA.engine;
const BLOCK = doubles(DATA.block), START = Object.fromEntries(Object.entries(DATA.start).map(([name, text]) => [name, doubles(text)]));
const SLIDERS = DATA.sliders.map(slider => ({ ...slider, value: slider.given }));

const isMoved = slider => slider.value !== slider.given;
// the number of a member: all members move with the slider, by the same amount; `given` is the first member's
const moved = (slider, own) => !isMoved(slider) ? own : slider.shared ? slider.value : own + (slider.value - slider.given);

function massRows([one, two, three], p) {
  return [1 / one, 1 / two, 1 / three, (two - three) / two / three, (three - one) / three / one, (one - two) / one / two, ...p];
}
function quaternion({ axes: [i, j, k], sign, proper }, [first, second, third]) {
  const [c, s] = [Math.cos, Math.sin], q = [0, 0, 0, 0];
  if (proper) {
    const [cs, ss] = [c(second / 2), s(second / 2)];
    q[0] = cs * c((first + third) / 2); q[i] = cs * s((first + third) / 2);
    q[j] = ss * c((first - third) / 2); q[k] = sign * (ss * s((first - third) / 2));
    return q;
  }
  const [[c1, s1], [c2, s2], [c3, s3]] = [first, second, third].map(x => [c(x / 2), s(x / 2)]);
  q[0] = c1 * c2 * c3 - sign * (s1 * s2 * s3); q[i] = s1 * c2 * c3 + sign * (c1 * s2 * s3);
  q[j] = c1 * s2 * c3 - sign * (s1 * c2 * s3); q[k] = c1 * c2 * s3 + sign * (s1 * s2 * c3);
  return q;
}
// the body of a member: { moments, mass, centre }
function bodyOf(member) {
  const own = { moments: [0, 1, 2].map(k => START.moments[k * WIDTH + member]), mass: START.mass[member],
    centre: [0, 1, 2].map(k => START.centre[k * WIDTH + member]) };
  for (const slider of SLIDERS.filter(isMoved)) {
    if (slider.kind === "mass") own.mass = moved(slider, own.mass);
    else if (slider.kind in own) own[slider.kind][slider.place] = moved(slider, own[slider.kind][slider.place]);
  }
  return own;
}
// why no body has the moments of a member, as the command line says it; "" if one has them
function impossible(member) {
  const { moments, mass, centre: c } = bodyOf(member);
  // about the centre of mass; the rounding of a flat body may exceed the sum by 1e-12
  const own = moments.map((x, k) => x - mass * (inner(c, c) - c[k] * c[k])), sum = own[0] + own[1] + own[2];
  if (own.every(x => x >= -1e-12 * Math.max(...moments) && 2 * x - sum <= 1e-12 * Math.max(...moments))) return "";
  const about = inner(c, c) > 0 ? " about the centre of mass" : "";
  return `No mass distribution has these moments: I_i <= I_j + I_k, but (${own.map(x => nice(+x.toPrecision(4))).join(", ")}) kg m²${about}.`;
}
function startRows() {
  const rows = Float64Array.from(BLOCK), changed = SLIDERS.filter(isMoved);
  const of = (...kinds) => changed.filter(slider => kinds.includes(slider.kind));
  for (let m = 0; m < WIDTH; m++) {
    const put = (row, values) => values.forEach((value, k) => { rows[(row + k) * WIDTH + m] = value; });
    for (const slider of of("effect")) put(slider.row, [moved(slider, rows[slider.row * WIDTH + m])]);
    const body = bodyOf(m);
    if (of("moments", "mass", "centre").length) put(AT.body, massRows(body.moments, body.centre.map(c => body.mass * c)));
    if (of("spin", "moments").length) {
      const spin = [0, 1, 2].map(k => START.spin[k * WIDTH + m]);
      for (const slider of of("spin")) spin[slider.place] = moved(slider, spin[slider.place]);
      put(AT.momentum, DATA.omega ? spin.map((x, k) => x * body.moments[k]) : spin);
    }
    if (of("angle").length) {
      const angles = [0, 1, 2].map(k => START.angles[k * WIDTH + m]);
      for (const slider of of("angle")) angles[slider.place] = moved(slider, angles[slider.place]);
      put(AT.attitude, quaternion(DATA.sequence, angles));
    }
  }
  return rows;
}
// the largest turn rate of a start: |L| over the least moment, of all members
function rateOf(rows) {
  let most = 0;
  for (let m = 0; m < WIDTH; m++) {
    const at = k => rows[(AT.momentum + k) * WIDTH + m];
    most = Math.max(most, Math.hypot(at(0), at(1), at(2)) * Math.max(...[0, 1, 2].map(k => rows[(AT.body + k) * WIDTH + m])));
  }
  return most;
}

// the largest turn rate itself, of all members
function spinOf(rows) {
  let most = 0;
  for (let m = 0; m < WIDTH; m++)
    most = Math.max(most, Math.hypot(...[0, 1, 2].map(k => rows[(AT.momentum + k) * WIDTH + m] * rows[(AT.body + k) * WIDTH + m])));
  return most;
}

// ---- the motion so far -----------------------------------------------------------------------

const MOST = 3000;       // samples of the trace and the charts
const SHOWN_RATE = DATA.isFree ? 5 : 9;   // initial turn rate on the screen [rad/s]: a top's precession is slower than its spin
const TURN = 0.12;       // largest turn between two samples [rad]
const BATCH = 48;        // most samples between two pictures
const OWN_TURN = 1.3 * Math.max(0.1, rateOf(BLOCK) * DATA.h);   // of a step [rad]
// time: what is shown; the engine makes the steps that lead to it and no others
const state = { run: 0, step: 0, h: DATA.h, rate: 0, playing: false, speed: 1, time: 0, members: 1, busy: false, frames: 0,
  samples: [], past: [], trail: [], rows: null, ready: false, fused: true, others: null, body: bodyOf(0), why: "", status: 0 };
let worker;

function begin(time = 0) {
  const rows = startRows();
  state.body = bodyOf(0);
  state.why = SLIDERS.some(s => isMoved(s) && ["moments", "mass", "centre"].includes(s.kind)) ? impossible(0) : "";
  state.rate = rateOf(rows);
  // a faster spin halves the step until a step turns no farther than in the scene itself
  state.h = DATA.h;
  while (state.rate * state.h > OWN_TURN && state.h > DATA.h / 4096) state.h /= 2;
  Object.assign(state, { run: state.run + 1, step: 0, time, rows, samples: [], others: null, status: 0 });
  first(rows);
  ask();
  draw();
}
function first(rows) {
  const at = (row, k) => rows[(row + k) * WIDTH];
  sample(0, [0, 1, 2, 3].map(k => at(AT.attitude, k)), [0, 1, 2].map(k => at(AT.momentum, k)), [0, 0]);
}
function sample(time, q, l, drift) {
  if (state.samples.length >= MOST) state.samples.splice(0, MOST / 10);
  state.samples.push({ time, q, l, drift });
}
// ask the engine for the steps up to the present: the last one ends there or after it
function ask() {
  const to = Math.ceil(state.time / state.h - 1e-6);   // a time that is a step, but for its rounding, is that step
  if (!state.ready || state.busy || to <= state.step) return;
  const rate = Math.max(state.rate, size(state.samples.at(-1).l) / Math.min(...state.body.moments));
  const turn = rate * state.h * (to - state.step), count = clamp(Math.ceil(turn / TURN), 1, BATCH);
  state.busy = true;
  worker.postMessage({ rows: state.rows, h: state.h, to, count, members: state.members, run: state.run });
  state.rows = null;
}
function receive({ data }) {
  if (data.failed) return fail(data.failed);
  if (data.ready) { Object.assign(state, { ready: true, fused: data.fused }); ask(); return draw(); }
  state.busy = false;
  if (data.run !== state.run) return ask();
  const { values } = DATA.engine, n = state.members, count = data.steps.length;
  for (let k = 0; k < count; k++) {
    const at = i => data.saves[(k * values + i) * n];
    sample(data.steps[k] * state.h, [at(0), at(1), at(2), at(3)], [at(4), at(5), at(6)], [at(7), at(8)]);
  }
  state.step = data.steps[count - 1];
  state.busyShare = data.busy;
  state.status = data.status[0];
  state.others = n > 1 ? data.saves.subarray((count - 1) * values * n) : null;
  if (!state.playing) draw();   // else the next picture shows it
}
// what is shown: the sample of this time, or a motion between two samples
function shown() {
  const { samples, time } = state;
  let k = samples.length - 1;
  while (k > 0 && samples[k - 1].time > time) k--;
  const after = samples[k], before = samples[k - 1], part = before ? (time - before.time) / (after.time - before.time) : 1;
  return part > 1 - 1e-6 ? { s: after, k } : { s: between(before, after, part, time), k: k - 1 };
}
// between two steps, for the eye alone: the attitude turns evenly from one sample to the next, and L in space moves straight
function between(before, after, part, time) {
  const along = before.q.reduce((sum, x, i) => sum + x * after.q[i], 0), angle = Math.acos(Math.min(1, Math.abs(along)));
  const [a, b] = angle < 1e-6 ? [1 - part, part] : [Math.sin((1 - part) * angle) / Math.sin(angle), Math.sin(part * angle) / Math.sin(angle)];
  // below 1e-6 rad the sines are their angles to 1e-12
  const q = before.q.map((x, i) => a * x + Math.sign(along || 1) * b * after.q[i]);
  const [one, two] = [before, after].map(s => times(matrix(s.q), s.l)), l = one.map((x, i) => (1 - part) * x + part * two[i]), turn = matrix(q);
  return { time, q, l: [0, 1, 2].map(k => turn[0][k] * l[0] + turn[1][k] * l[1] + turn[2][k] * l[2]), drift: before.drift };
}
function fail(why) {
  state.failed = true;
  warn(`This page cannot compute here (${why}): a policy of the browser may forbid WebAssembly. `
    + `Its recorded form is: rigidmc view ${DATA.source}`, "This page cannot compute");
}
// write the note; it begins with the key of a warning, "" for none
function warn(words, key) {
  $("note").className = key ? "bad" : "";
  $("note").replaceChildren(html("strong", {}, key), words.slice(key.length));
}

// ---- what is drawn ---------------------------------------------------------------------------

const omegaOf = s => s.l.map((x, k) => x / state.body.moments[k]);
function eulerOf(s) {   // z-x-z: axis 3 of the body in space has the polar angles theta and phi - 90 degrees
  const a = matrix(s.q);
  return [Math.atan2(a[0][2], -a[1][2]), Math.acos(clamp(a[2][2], -1, 1)), Math.atan2(a[2][0], a[2][1])];
}
function thetaRate(s) { const [w1, w2] = omegaOf(s), psi = eulerOf(s)[2]; return w1 * Math.cos(psi) - w2 * Math.sin(psi); }
const QUANTITIES = {
  omega: ["angular velocity, body axes", "ω [rad/s]", ["ω₁", "ω₂", "ω₃"], omegaOf],
  theta: ["nutation angle θ of axis 3", "θ [degrees]", ["θ"], s => [degrees(eulerOf(s)[1])]],
  euler: ["Euler angles z-x-z", "angle [degrees]", ["φ", "θ", "ψ"], s => eulerOf(s).map(degrees)],
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


function drawInSpace(stage, s) {
  const turn = matrix(s.q), trace = state.trail.slice(-TRACE).map(one => matrix(one.q).map(row => row[2]));
  drawBody(stage, { turn, ...form(), l: sized(times(turn, s.l), 1), trace, pulls: DATA.pulls });
  $("space-words").textContent = "Orange: angular momentum L, and the trace of axis 3.";
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
  $("inside-words").textContent = "L in the principal axes. Thin lines: polhodes; thick: separatrix.";
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

function draw() {
  if (!state.samples.length || !stages) return;
  const { s, k } = shown();
  state.past = state.samples.slice(0, k + 1);
  state.trail = $("trace").checked ? [...state.past, s] : [s];
  state.frames++;
  stages.body.begin(); stages.sphere.begin();
  ({ body: drawInSpace, poinsot: drawPoinsot })[$("space").value](stages.body, s);
  ({ momentum: drawMomentum, ellipsoid: drawEllipsoid })[$("inside").value](stages.sphere, s);
  stages.body.end(); stages.sphere.end();
  drawCharts();
  $("clock").textContent = `${s.time.toPrecision(4)} s`;
  if (state.failed) return;
  const flagged = Object.entries(DATA.statuses).find(([, code]) => code === state.status);
  const words = (state.why && `${state.why} `) + (flagged[1] ? `Flagged: ${flagged[0].replaceAll("_", " ")}; the body stays at its last good state.`
    : `${DATA.integrator}, step ${nice(+state.h.toPrecision(4))} s, ${state.step.toLocaleString("en")} step${state.step === 1 ? "" : "s"}, computed in this page with the same `
      + `bits as the command line${state.fused ? "" : " (this machine has no fused multiply-add: slower)"}. Drag to turn, scroll or pinch to zoom.`);
  warn(words, state.why ? "No mass distribution" : flagged[1] ? "Flagged" : "");
}
function drawCharts() {
  const samples = state.past, t = samples.map(s => s.time);
  const [, upward, names, of] = QUANTITIES[$("quantity").value], found = samples.map(of);
  const series = names.map((_, k) => ({ x: t, y: found.map(one => one[k]) }));
  if ($("quantity").value === "euler") for (const { y } of series)
    for (let i = 1; i < y.length; i++) y[i] -= 360 * Math.round((y[i] - y[i - 1]) / 360);
  charts.motion.draw({ series, across: "time [s]", upward });
  legend("names", names);
  const [, one, two, pair] = PHASES[$("phase").value], pairs = samples.map(pair);
  charts.portrait.draw({ series: [{ x: pairs.map(p => p[0]), y: pairs.map(p => p[1]) }], across: one, upward: two, dots: true });
  const log = k => ({ x: t, y: samples.map(s => Math.log10(Math.max(Math.abs(s.drift[k]), 1e-17))) });
  charts.drift.draw({ series: [log(0), log(1)], across: "time [s]", upward: "relative drift", log: true });
  legend("drifts", DATA.conserved.map((kept, k) => ["energy", "|L|²"][k] + (kept ? "" : " (not conserved here)")));
}
