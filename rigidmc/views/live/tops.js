// ---- heavy symmetric tops: starts by closed forms, and readings of the motion so far -----------

// the first member as a heavy symmetric top about axis 3, null if it is none: k = m g l, slow and fast are the rates of
// steady precession (Goldstein, section 5.7), nan if omega_3 is too small, and least is the spin above which an upright top sleeps
function topOf() {
  const { moments: [i1, i2, i3], mass, centre: [c1, c2, c3] } = state.body;
  if (DATA.gravity === null || Math.abs(i1 - i2) > 1e-12 * i1 || c1 || c2) return null;
  const g = SLIDERS.find(s => s.row === DATA.gravity)?.value ?? BLOCK[DATA.gravity * WIDTH], k = mass * g * c3;
  const [, theta, psi] = anglesOf(0), spin = spinOf(0)[2] * (DATA.omega ? i3 : 1);
  // the cosine of pi/2 is 6e-17
  const cosine = Math.abs(Math.cos(theta)) <= 4 * Number.EPSILON ? 0 : Math.cos(theta), rise = i1 * cosine;
  const larger = 0.5 * (spin + (spin < 0 ? -1 : 1) * Math.sqrt(spin * spin - 4 * rise * k));
  return { i1, i3, k, theta, psi, spin, slow: k / larger, fast: larger / rise, least: 2 * Math.sqrt(i1 * Math.max(k, 0)) / i3,
    needed: 2 * Math.sqrt(Math.max(rise * k, 0)) / i3 };
}
const byPlace = (kind, place) => SLIDERS.find(s => s.kind === kind && s.place === place);
// the rate of precession at the start, in that of steady precession
const PRESETS = { "steady precession": 1, waves: 0.5, cusps: 0, loops: -1 }, UPRIGHT = 0.01;   // rad, of a sleeping top that may fall
const isVertical = theta => Math.abs(Math.sin(theta)) < 1e-9;   // the rounding of a turn makes 1e-16 rad, without a direction
function setPreset(word) {
  const top = topOf(), per = DATA.omega ? 1 : top.i1, [first, second, third] = [0, 1, 2].map(k => byPlace("spin", k)), lean = byPlace("angle", 1);
  if (word === "sleeping") {
    lean.set(UPRIGHT); first?.set(0); second.set(0);
    if (Math.abs(top.spin) < 1.1 * top.least * top.i3) third.set((top.spin < 0 ? -1 : 1) * 1.1 * top.least * (DATA.omega ? 1 : top.i3));
  } else if (isVertical(top.theta)) {
    return tell("The axis is vertical, where a push has no direction: let it lean first, by θ(0).");
  } else if (top.k === 0) {
    return tell("No weight turns this top: without a push its axis stands still, and with one it circles L.");
  } else if (PRESETS[word] && isNaN(top.slow)) {
    return tell(`No steady precession at this lean: it needs |ω₃| above ${nice(+top.needed.toPrecision(4))} rad/s, and ω₃ is ${nice(+(top.spin / top.i3).toPrecision(4))} rad/s.`);
  } else {
    const push = PRESETS[word] && PRESETS[word] * top.slow * Math.sin(top.theta) * per;
    first?.set(push * Math.sin(top.psi)); second.set(push * Math.cos(top.psi));
  }
  begin();
  play(true);
}
// the ends of the sliders of omega_1 and omega_2: twice the push of steady precession, at 0.1 rad for a top that is upright
function followTop() {
  const top = topOf();
  for (const button of $("presets").children) button.disabled = !top;
  if (!top || !top.spin) return;
  const push = 2 * Math.max(Math.sin(top.theta), 0.1) * Math.abs(isNaN(top.slow) ? 2 * top.k / top.spin : top.slow) * (DATA.omega ? 1 : top.i1);
  for (const slider of [0, 1].map(k => byPlace("spin", k))) if (slider?.usual && push > 0) {
    slider.high = Math.max(+push.toPrecision(2), Math.abs(slider.value));
    slider.low = -slider.high;
    slider.set(slider.value);
  }
}
const RESOLVED = 6;   // samples of a nutation, below which they might miss one
const NODDING = 1e-3;   // degrees between the ends of theta, below which they may be rounding
// the times of the highest theta between samples: the tops of parabolas through three samples; none of a motion without
// nutation, or if samples might miss nutations
function peaksOf(t, theta) {
  const peaks = [];
  for (let i = 1; i + 1 < t.length; i++) if (theta[i] > theta[i - 1] && theta[i] >= theta[i + 1]) {
    const [a, b] = [(theta[i] - theta[i - 1]) / (t[i] - t[i - 1]), (theta[i + 1] - theta[i]) / (t[i + 1] - t[i])];
    peaks.push(0.5 * (t[i - 1] + t[i] + (t[i + 1] - t[i - 1]) * a / (a - b)));
  }
  const isClear = !DATA.isFree && !DATA.isRandom && Math.max(...theta) - Math.min(...theta) > NODDING;
  return isClear && t.length > RESOLVED * (peaks.length - 1) ? peaks : [];
}
// [name, words] of numbers: of the latest sample, and of all that the charts show
function readings(samples, t, peaks) {
  const last = samples.at(-1), digits = (x, n = 4) => nice(+x.toPrecision(n)), list = [], theta = samples.map(s => degrees(eulerOf(s)[1]));
  const low = Math.min(...theta), high = Math.max(...theta);
  list.push(["θ", `${digits(theta.at(-1))}° (${digits(low)}° to ${digits(high)}°)`]);
  if (!DATA.isFree && t.length > 2 && !samples.every(s => isVertical(eulerOf(s)[1]))) {
    const phi = unwrapped(samples.map(s => degrees(eulerOf(s)[0]))), isWhole = peaks.length > 1;
    const rate = isWhole ? meanRate(t, phi, peaks) : (phi.at(-1) - phi[0]) / (t.at(-1) - t[0]);
    list.push([`mean dφ/dt${isWhole || high - low < NODDING ? "" : " so far"}`, `${digits(rate)}°/${CLOCK.one}`]);
  }
  const count = peaks.length - 1;
  if (count > 0) list.push(["nutation", `${digits((peaks.at(-1) - peaks[0]) / count)} ${CLOCK.unit}, mean of ${count.toLocaleString("en")}`]);
  if (isFinite(last.energy)) list.push(["E", `${digits(last.energy, 6)} J`]);
  list.push(["|L|²", `${digits(inner(last.l, last.l), 6)} kg² m⁴/s²`]);
  const top = topOf();
  if (!top?.spin || !top.k) return list;
  // up to twice k/p_psi the axis traces waves, if it does not reach the vertical before
  const across = Math.sin(top.theta), side = Math.sign(top.k);
  if (top.spin ** 2 > 2 * top.i1 * side * top.k * (1 + side * Math.cos(top.theta)) && !isVertical(top.theta))
    list.push(["waves for a push dφ/dt sin θ of 0 to", `${digits(2 * top.k / top.spin * across)} rad/s`]);
  list.push(["steady precession", isNaN(top.slow) ? `from |ω₃| = ${digits(top.needed)} rad/s on`
    : `${digits(degrees(top.slow) * CLOCK.by)}°/${CLOCK.one}, a push of ${digits(top.slow * across)} rad/s`]);
  if (top.least) list.push(["sleeps upright from |ω₃| =", `${digits(top.least)} rad/s on`]);
  return list;
}
