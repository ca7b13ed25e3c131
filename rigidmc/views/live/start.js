// ---- the start: rows of the members, as Python builds them -----------------------------------

const doubles = text => new Float64Array(bytes(text).buffer);
const { width: WIDTH, rows: AT } = DATA.engine;
const BLOCK = doubles(DATA.block), START = Object.fromEntries(Object.entries(DATA.start).map(([name, text]) => [name, doubles(text)]));
const SLIDERS = DATA.sliders.map(slider => ({ ...slider, value: slider.given, spread: slider.spread && doubles(slider.spread) }));

const isMoved = slider => slider.value !== slider.given;
// the numbers by which the distribution of a slider moves, moved
const located = (slider, source = slider.source) => slider.locations.map(([name, k]) => (source[name][k] ?? 0) + (slider.value - slider.given));
// whether members have the slider's number itself: all, or one, whose other numbers come from no point set of all distributions
const isNumber = slider => slider.shared || state.members === 1 && (DATA.isIndependent || slider.source === null);
// the number of member m, `own` in the scene: else the whole distribution moves, `given` being the first member's
function moved(slider, own, m) {
  if (!isMoved(slider)) return own;
  if (isNumber(slider)) return slider.value;
  if (!slider.spread) return own + (slider.value - slider.given);
  const [low, high] = located(slider);
  return high === undefined ? low + slider.spread[m] : low + (high - low) * slider.spread[m];
}

function massRows([one, two, three], p) {
  return [1 / one, 1 / two, 1 / three, (two - three) / two / three, (three - one) / three / one, (one - two) / one / two, ...p];
}
// [sin x, cos x] with the bits of `rigidmc.physics.dynamics.functions.sincos`: Math.sin may round otherwise
const polynomial = (z, ...factors) => factors.reduce((p, factor) => factor + z * p);
const nearest = x => x + 6755399441055744 - 6755399441055744;   // 1.5 * 2^52, beyond which doubles are integers
function sincos(x) {
  const n = nearest(x * 0.63661977236758134308);
  const r = x - n * 1.57079632673412561417 - n * 6.07710050630396597660e-11 - n * 2.02226624879595063154e-21, z = r * r;
  const s = r + r * z * polynomial(z, 1.58969099521155010221e-10, -2.50507602534068634195e-08, 2.75573137070700676789e-06,
    -1.98412698298579493134e-04, 8.33333333332248946124e-03, -1.66666666666666324348e-01);
  const c = 1 - (0.5 * z - z * z * polynomial(z, -1.13596475577881948265e-11, 2.08757232129817482790e-09, -2.75573143513906633035e-07,
    2.48015872894767294178e-05, -1.38888888888741095749e-03, 4.16666666666666019037e-02));
  return [[s, c], [c, -s], [-s, -c], [-c, s]][n - 4 * Math.floor(n / 4)];
}
function quaternion({ axes: [i, j, k], sign, proper }, [first, second, third]) {
  const q = [0, 0, 0, 0];
  if (proper) {
    const [[s, c], [splus, cplus], [sminus, cminus]] = [second, first + third, first - third].map(x => sincos(x / 2));
    q[0] = c * cplus; q[i] = c * splus; q[j] = s * cminus; q[k] = sign * (s * sminus);
    return q;
  }
  const [[s1, c1], [s2, c2], [s3, c3]] = [first, second, third].map(x => sincos(x / 2));
  q[0] = c1 * c2 * c3 - sign * (s1 * s2 * s3); q[i] = s1 * c2 * c3 + sign * (c1 * s2 * s3);
  q[j] = c1 * s2 * c3 - sign * (s1 * c2 * s3); q[k] = c1 * c2 * s3 + sign * (s1 * s2 * c3);
  return q;
}
// the body of a member: { moments, mass, centre }
function bodyOf(member) {
  const own = { moments: [0, 1, 2].map(k => START.moments[k * WIDTH + member]), mass: START.mass[member],
    centre: [0, 1, 2].map(k => START.centre[k * WIDTH + member]) };
  for (const slider of SLIDERS.filter(isMoved)) {
    if (slider.kind === "mass") own.mass = moved(slider, own.mass, member);
    else if (slider.kind in own) own[slider.kind][slider.place] = moved(slider, own[slider.kind][slider.place], member);
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
// the spin and the Euler angles of a member, as START has them, with the sliders
function withSliders(kind, array, m) {
  const values = [0, 1, 2].map(k => array[k * WIDTH + m]);
  for (const slider of SLIDERS) if (slider.kind === kind && isMoved(slider)) values[slider.place] = moved(slider, values[slider.place], m);
  return values;
}
const spinOf = m => withSliders("spin", START.spin, m), anglesOf = m => withSliders("angle", START.angles, m);
function startRows() {
  const rows = Float64Array.from(BLOCK), changed = SLIDERS.filter(isMoved);
  const of = (...kinds) => changed.filter(slider => kinds.includes(slider.kind));
  for (let m = 0; m < WIDTH; m++) {
    const put = (row, values) => values.forEach((value, k) => { rows[(row + k) * WIDTH + m] = value; });
    for (const slider of of("effect")) put(slider.row, [moved(slider, rows[slider.row * WIDTH + m], m)]);
    for (const [row, of] of DATA.sums) put(row, [of.map(k => rows[k * WIDTH + m]).reduce((sum, x) => sum + x)]);
    const body = bodyOf(m);
    if (of("moments", "mass", "centre").length) put(AT.body, massRows(body.moments, body.centre.map(c => body.mass * c)));
    if (of("spin", "moments").length) put(AT.momentum, DATA.omega ? spinOf(m).map((x, k) => x * body.moments[k]) : spinOf(m));
    if (of("angle").length) put(AT.attitude, quaternion(DATA.sequence, anglesOf(m)));
  }
  return rows;
}
// the largest |omega| of a free body with this momentum: on its polhode, where L_k^2 is linear, it lies at an end, L_k = 0
function fastest(l, inverse) {
  const square = inner(l, l), twice = l.reduce((sum, x, k) => sum + x * x * inverse[k], 0);
  let most = l.reduce((sum, x, k) => sum + (x * inverse[k]) ** 2, 0);
  for (const [i, j] of [[0, 1], [1, 2], [2, 0]]) {
    const x = (twice - inverse[j] * square) / (inverse[i] - inverse[j]), y = square - x;
    if (x >= 0 && y >= 0) most = Math.max(most, x * inverse[i] ** 2 + y * inverse[j] ** 2);
  }
  return Math.sqrt(most);
}
const rowsOf = (rows, row, m) => [0, 1, 2].map(k => rows[(row + k) * WIDTH + m]);
const most = (rows, of) => Array.from({ length: WIDTH }, (_, m) => of(rowsOf(rows, AT.momentum, m), rowsOf(rows, AT.body, m))).reduce((a, b) => Math.max(a, b));
// integrators whose form depends on the rate have one for this bound, |L| over the least moment
const rateOf = rows => most(rows, DATA.engine.turn_rates.own === null ? fastest : (l, inverse) => size(l) * Math.max(...inverse));
// the form of the integrator for a start: of the scene's own, or whether two moments are equal, as the command line finds it
function formOf(rows) {
  if (!SLIDERS.some(isMoved) || DATA.engine.turn_rates.own === null) return "own";
  const inverse = rowsOf(rows, AT.body, 0), shape = rowsOf(rows, AT.body + 3, 0);
  return !DATA.isBodyDrawn && Math.min(...shape.map(Math.abs)) <= 4e-15 * Math.max(...inverse) ? "equal" : "unequal";
}
// the largest turn rate at the start itself, of all members
const turnRateOf = rows => most(rows, (l, inverse) => size(l.map((x, k) => x * inverse[k])));

// ---- the scene file of this motion -----------------------------------------------------------

// a value as TOML; Python and JavaScript write the same digits of a double
const toml = value => Array.isArray(value) ? `[${value.map(toml).join(", ")}]`
  : value !== null && typeof value === "object" ? `{ ${Object.entries(value).map(([key, x]) => `${key} = ${toml(x)}`).join(", ")} }` : Object.is(value, -0) ? "-0.0" : String(value);
const OF_BODY = ["moments", "mass", "centre"], isBodyMoved = () => SLIDERS.some(s => isMoved(s) && OF_BODY.includes(s.kind));

// what a number is in the file: the number of all members, or a distribution, moved; null for rows of a table
function quantity(slider) {
  if (isNumber(slider) && (slider.shared || isMoved(slider) || slider.source === null)) return slider.value;
  if (!isMoved(slider) || !slider.locations.length) return slider.source;
  const source = structuredClone(slider.source), numbers = located(slider);
  slider.locations.forEach(([name, k], i) => { source[name][k] = numbers[i]; });
  return source;
}
// { text: all that this page uses, as a scene file, "" if no file can say it; lost: moved sliders that the file leaves out }
function savedScene() {
  const form = DATA.scene[isBodyMoved() ? "with_moments" : "as_given"], values = SLIDERS.map(quantity);
  const lost = SLIDERS.filter((s, k) => isMoved(s) && (!form.includes(`"@${k}@"`) || values[k] === s.source));
  const text = Object.entries({ dt: state.h, members: state.members, turn_rate: DATA.engine.turn_rates[state.form] * (DATA.h / state.h), ...values })
    .reduce((text, [mark, value]) => text.replaceAll(`"@${mark}@"`, () => toml(value)), form);
  const isOfTable = values.some((value, k) => value === null && form.includes(`"@${k}@"`)) || /^\s*(\{ )?stored = /m.test(text);
  return { text: isOfTable ? "" : text, lost };
}
