// ---- the recorded motion ---------------------------------------------------------------------

const SHOWN_RATE = 3;       // initial turn rate of the body on the screen [rad/s]
const floats = array => array.f4 ? new Float32Array(bytes(array.f4).buffer)
  : Float32Array.from(new Int16Array(bytes(array.i2).buffer), x => x / 32767);
for (const m of DATA.members) {
  m.frames = m.q.shape[0];
  for (const key of ["q", "u", "size", "radius"]) if (m[key]) m[key] = floats(m[key]);
  for (const one of m.readings ?? []) for (const key of ["t", "data", "model", "residual"])
    one[key] = Array.isArray(one[key]) ? one[key].map(floats) : floats(one[key]);
  if (m.drift) for (const key of ["t", "energy_drift", "l2_drift"]) m.drift[key] = floats(m.drift[key]);
}
const CROWD = DATA.density && new Density({ ...DATA.density, t: floats(DATA.density.t) });
const SHAPE = { corners: new Float32Array(bytes(DATA.shape.corners).buffer), tones: DATA.shape.faces.map(tone => DATA.tones[tone]) };

// components of row i + w of an array with `width` columns
function between(array, width, i, w) {
  const j = Math.min(i + 1, array.length / width - 1), row = [];
  for (let k = 0; k < width; k++)
    row.push((1 - w) * array[width * i + k] + w * array[width * j + k]);
  return row;
}
// m.axes: the described axes in the principal axes, where they differ
function described(m, v) {
  return m.axes ? m.axes.map(axis => inner(axis, v)) : v;
}
// the rotation matrix of the described axes, from that of the principal axes
function describedTurn(m, turn) {
  return m.axes ? turn.map(row => m.axes.map(axis => inner(row, axis))) : turn;
}
const turnOf = (m, i) => describedTurn(m, matrix(m.q.subarray(4 * i, 4 * i + 4)));
const towardOf = (m, i) => [0, 1, 2].map(k => m.u[3 * i + k]);

function stateAt(m, t) {
  const place = clamp(t / m.end, 0, 1) * (m.frames - 1);
  const i = Math.min(Math.floor(place), Math.max(m.frames - 2, 0)), w = place - i;
  const q = sized(between(m.q, 4, i, w), 1), u = sized(between(m.u, 3, i, w), 1);
  return { i, w, q, u, size: between(m.size, 1, i, w)[0], turn: matrix(q) };
}

// ---- the page ------------------------------------------------------------------------------

const page = { t: 0, member: 0, playing: false, speed: 1, frames: 0 };
const member = () => DATA.members[page.member];
let stages, charts, pixels;

const omegaOf = (m, i) => described(m, towardOf(m, i).map((x, j) => m.largest * m.size[i] * x / m.moments[j]));
// TdC (3.36): axis 3 of the body in space has the polar angles theta and phi - 90 degrees
function eulerOf(m, i) {
  const a = turnOf(m, i);
  return [Math.atan2(a[0][2], -a[1][2]), Math.acos(clamp(a[2][2], -1, 1)), Math.atan2(a[2][0], a[2][1])].map(degrees);
}
// { quantity: [name, label, names of its lines, values of a frame] }
const QUANTITIES = {
  omega: ["angular velocity, body axes", "ω [rad/s]", ["ω₁", "ω₂", "ω₃"], omegaOf],
  theta: ["nutation angle θ of axis 3", "θ [degrees]", ["θ"], (m, i) => [eulerOf(m, i)[1]]],
  euler: ["Euler angles z-x-z", "angle [degrees]", ["φ", "θ", "ψ"], eulerOf],
  direction: ["direction of L, body axes", "L/|L|", ["1", "2", "3"], (m, i) => described(m, towardOf(m, i))],
};
// of a fit, whose members are its records: readings as circles on the motion, and their residuals
const FITTED = DATA.members[0]?.readings?.length > 0, nameOf = m => FITTED ? `record ${m.index + 1}` : `member ${m.index}`;
if (FITTED) DATA.members[0].readings.forEach(({ name, upward, names }, k) => {
  QUANTITIES[`readings ${k}`] = [`readings of ${name}, and the fitted motion`, upward, names];
});
function readings() {
  const { t: x, data, model, residual, names } = member().readings[$("quantity").value.split(" ")[1] ?? 0];
  const all = (rows, marks) => rows.map((y, tone) => ({ x, y, name: names[tone], tone, marks }));
  return { names, motion: [...all(model), ...all(data, true)], rest: all(residual, true) };
}
function quantity() {
  const m = member(), key = $("quantity").value, [, upward, names, of] = QUANTITIES[key];
  if (!of) {
    charts.motion.draw({ series: readings().motion, across: "time [s]", upward });
    return legend("names", names);
  }
  const t = Array.from({ length: m.frames }, (_, i) => m.end * i / (m.frames - 1 || 1)), found = t.map((_, i) => of(m, i));
  const series = names.map((name, k) => ({ name, x: t, y: found.map(one => one[k]) }));
  if (key === "euler") for (const { y } of series)
    for (let i = 1; i < y.length; i++) y[i] -= 360 * Math.round((y[i] - y[i - 1]) / 360);
  charts.motion.draw({ series, across: "time [s]", upward });
  legend("names", names);
}
function drifts() {
  const { drift } = member();
  if (FITTED) {
    const { rest, names } = readings();
    charts.drift.draw({ series: rest, across: "time [s]", upward: "residual/noise" });
    return legend("drifts", names);
  }
  if (!drift) return;
  const log = (name, key) => ({ name, x: drift.t, y: Array.from(drift[key], v => Math.log10(Math.max(Math.abs(v), 1e-17))) });
  charts.drift.draw({ series: [log("energy", "energy_drift"), log("|L|²", "l2_drift")], across: "time [s]", upward: "relative drift", log: true });
  const kept = key => drift.conserved[key].startsWith("no") ? " (not conserved here)" : "";
  legend("drifts", ["energy" + kept("energy_drift"), "|L|²" + kept("l2_drift")]);
}

function draw() {
  const m = member(), s = stateAt(m, page.t), { body, sphere } = stages;
  body.begin(); sphere.begin();
  drawBody(body, { turn: s.turn, axes: describedTurn(m, s.turn), ...SHAPE, form: m.form, l: sized(times(s.turn, s.u), s.size),
    trace: [...page.tips.slice(Math.max(0, s.i + 1 - TRACE), s.i + 1), describedTurn(m, s.turn).map(row => row[2])],
    centre: m.centre, pulls: DATA.pulls, radius: m.radius && sized([...between(m.radius, 2, s.i, s.w), 0], 1) });
  // polhodes are in the principal axes, whose moments name them where these are not the body's axes
  drawSphere(sphere, { moments: m.moments, names: m.axes ? ["I₁", "I₂", "I₃"] : undefined, u: s.u, path: page.path,
    density: CROWD && CROWD.at(page.t) });
  body.end(); sphere.end();
  charts.motion.cursor(page.t);
  if (m.drift) charts.drift.cursor(page.t);
  $("slider").value = page.t / m.end;
  $("clock").textContent = `${page.t.toPrecision(4)} s`;
}
function redraw() {
  if (pixels) pixels.draw();
  quantity(); drifts(); draw();
}

function seek(t) { page.t = clamp(t, 0, member().end); draw(); }
function step(n) {
  const m = member(), h = m.end / (m.frames - 1 || 1);
  play(false);
  seek((Math.round(page.t / h) + n) * h);
}
let last;
function tick(now) {
  if (!page.playing) return;
  const { end } = member();
  page.t += page.speed * (now - last) / 1000;
  last = now;
  if (page.t > end) page.t = end > 0 ? page.t % end : 0;
  page.frames++;
  draw();
  requestAnimationFrame(tick);
}
function play(on) {
  const began = on && !page.playing;
  page.playing = on;
  $("play").textContent = on ? "❚❚" : "▶";
  if (began) { last = performance.now(); requestAnimationFrame(tick); }
}
function choose(k) {
  page.member = k;
  const m = member(), frames = Array.from({ length: m.frames }, (_, i) => i);
  page.tips = frames.map(i => turnOf(m, i).map(row => row[2]));
  page.path = frames.map(i => towardOf(m, i));
  page.t = Math.min(page.t, m.end);
  page.speed = listSpeeds(m.rate > 0 ? SHOWN_RATE / m.rate : 1);
  $("note").textContent = `${nameOf(m).replace(/^./, x => x.toUpperCase())}: ${m.status === "ok" ? "" : `flagged (${m.status}), frozen at its last good state; `}` +
    `${m.frames.toLocaleString("en")} frames of ${+m.end.toPrecision(4)} s, ${m.steps}` +
    `${m.whole ? "" : "; the run continues after that"}. Drag to rotate, scroll or pinch to zoom; space plays, arrows step.`;
  redraw();
}

function start() {
  stages = { body: new Stage($("body"), -0.95, 0.32, 1.6, draw), sphere: new Stage($("sphere"), 0.62, 0.42, 1.5, draw) };
  // the sphere faces the octant of the first momentum
  const { sphere } = stages, [x, y, z] = towardOf(DATA.members[0], 0);
  sphere.azimuth = Math.atan2(y < 0 ? -0.6 : 0.6, x < 0 ? -0.8 : 0.8);
  if (z < 0) sphere.elevation *= -1;
  charts = { motion: new Chart($("motion")), drift: new Chart($("drift")) };
  listOptions("member", DATA.members.map((m, k) => [k, `${nameOf(m).split(" ")[1]}${m.status === "ok" ? "" : " ⚑ " + m.status}`]));
  listOptions("quantity", Object.entries(QUANTITIES).map(([key, [name]]) => [key, name]));
  $("quantity").value = FITTED ? "readings 0" : DATA.quantity;
  if (FITTED) {
    $("drifting").querySelector("figcaption").firstChild.data = "Residuals of the readings, over their noise ";
    $("pick").firstChild.data = "record ";
  }
  $("crowd").textContent = CROWD ? `Blue: density of ${DATA.density.members.toLocaleString("en")} members.` : "";
  const pulls = DATA.pulls.map(([name]) => ({ g: "gravity (g)", B: "field (B)" })[name]);
  if (DATA.members[0].radius) pulls.unshift("local vertical of the orbit (r)");
  document.querySelector(".weight").textContent = pulls.length ? `Green: ${pulls.join(", ")}.` : "";
  $("member").onchange = event => choose(Number(event.target.value));
  $("speed").onchange = event => { page.speed = Number(event.target.value); };
  $("quantity").onchange = redraw;
  $("slider").oninput = event => seek(event.target.value * member().end);
  $("play").onclick = () => play(!page.playing);
  $("back").onclick = () => step(-1);
  $("on").onclick = () => step(1);
  for (const chart of Object.values(charts)) chart.onPick(seek);
  onKeys({ " ": () => play(!page.playing), ArrowLeft: () => step(-1), ArrowRight: () => step(1),
    Home: () => seek(0), End: () => seek(member().end), d: () => $("dark").click() });
  onResize(redraw);
  if (DATA.map) pixels = new Pixels(DATA.map);
  followTheme(() => page.tips && redraw());
  choose(0);
}
start();
