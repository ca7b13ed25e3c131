// ---- the motion so far -----------------------------------------------------------------------

const MOST = 3000;       // samples of the trace and the charts
const SHOWN_RATE = DATA.isFree ? 5 : 9;   // initial turn rate on the screen [rad/s]: a top's precession is slower than its spin
const TURN = 0.12;       // largest turn between two samples [rad]
const BATCH = 48;        // most samples between two pictures
const LONGEST = 1e4;     // ms that the engine works for a time that a link asks for
const OWN_TURN = DATA.engine.slack * Math.max(DATA.engine.least_turn, rateOf(BLOCK) * DATA.h);   // of a step [rad]
// time: what is shown; the engine makes the steps that lead to it and no others; spent: ms of work for it
const state = { run: 0, step: 0, h: DATA.h, rate: 0, playing: false, speed: 1, time: 0, members: 1, busy: false, frames: 0, spent: 0,
  samples: [], past: [], trail: [], rows: null, ready: false, fused: true, others: null, body: bodyOf(0), why: "", status: 0, most: {} };
let worker;

function begin(time = 0) {
  const rows = startRows();
  state.body = bodyOf(0);
  state.why = isBodyMoved() ? impossible(0) : "";
  state.form = formOf(rows);
  state.rate = rateOf(rows);
  // a faster spin halves the step until a step turns no farther than in the scene itself
  state.h = DATA.h;
  while (state.rate * state.h > OWN_TURN && state.h > DATA.h / 4096) state.h /= 2;
  Object.assign(state, { run: state.run + 1, step: 0, time, rows, samples: [], others: null, status: 0, spent: 0, most: { omega: 0, torque: 0 } });
  tell("");
  first(rows);
  followTop();
  ask();
  draw();
}
function first(rows) {
  const at = (row, k) => rows[(row + k) * WIDTH];
  sample({ time: 0, q: [0, 1, 2, 3].map(k => at(AT.attitude, k)), l: [0, 1, 2].map(k => at(AT.momentum, k)), drift: [0, 0], energy: NaN });
}
// torque: the mean of dL/dt in space since the sample before
function sample(s) {
  const { samples, most } = state, before = samples.at(-1);
  s.space = times(matrix(s.q), s.l);
  s.torque = before ? sub(s.space, before.space).map(x => x / (s.time - before.time)) : [0, 0, 0];
  most.omega = Math.max(most.omega, size(omegaOf(s)));
  most.torque = Math.max(most.torque, size(s.torque));
  if (samples.length >= MOST) samples.splice(0, MOST / 10);
  samples.push(s);
}
// ask the engine for the steps up to the present: the last one ends there or after it
function ask() {
  let to = Math.ceil(state.time / state.h - 1e-6);   // a time that is a step, but for its rounding, is that step
  if (!state.ready || state.busy || to <= state.step) return;
  const rate = Math.max(state.rate, fastest(state.samples.at(-1).l, state.body.moments.map(x => 1 / x)));
  // samples that show the turning: of a long way only its end has them, and what was before is left out
  const turn = rate * state.h, dense = Math.ceil(0.9 * MOST * TURN / turn), isLong = to - state.step > dense;
  if (isLong) to -= dense;
  // a body that starts at rest turns faster later
  const count = isLong ? 1 : state.playing ? clamp(Math.ceil(turn * (to - state.step) / TURN), 1, BATCH) : 0.9 * MOST;
  state.busy = true;
  worker.postMessage({ rows: state.rows, form: DATA.engine.forms[state.form], h: state.h, to, count, members: state.members, run: state.run, isLong });
  state.rows = null;
}
function receive({ data }) {
  if (data.failed) return fail(data.failed);
  if (data.ready) { Object.assign(state, { ready: true, fused: data.fused }); ask(); return draw(); }
  state.busy = false;
  if (data.run !== state.run) return ask();
  const { values } = DATA.engine, count = data.steps.length;
  if (data.isLong || data.steps[0] === 0) state.samples = [];
  for (let k = data.isLong ? count - 1 : 0; k < count; k++) {
    const [a, b, c, d, x, y, z, energyDrift, squareDrift, energy] = data.saves.subarray(k * values, (k + 1) * values);
    sample({ time: data.steps[k] * state.h, q: [a, b, c, d], l: [x, y, z], drift: [energyDrift, squareDrift], energy });
  }
  state.step = data.steps[count - 1];
  state.spent += data.busy;
  state.status = data.status[0];
  state.others = state.members > 1 ? data.all : null;
  if (state.playing) { state.spent = 0; return; }   // the next picture shows it, and asks
  if (state.spent < LONGEST) ask();
  else if (state.step * state.h < state.time) {
    tell(`${$("told").textContent} The time ${nice(state.time)} s takes ${nice(Math.ceil(state.time / state.h))} steps: this page stopped after ${LONGEST / 1000} s of work, at step ${state.step.toLocaleString("en")}.`);
    state.time = state.step * state.h;
  }
  draw();
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
  return { time, q, l: back(turn, l), drift: before.drift, energy: before.energy, torque: after.torque };
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
