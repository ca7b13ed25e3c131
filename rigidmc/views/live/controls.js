// ---- the reader's hands ----------------------------------------------------------------------

let last;
function tick(now) {
  if (!state.playing) return;
  const passed = Math.min(0.1, (now - last) / 1000);   // a hidden page rests
  last = now;
  if (!state.busy && state.step * state.h > state.time - state.h) state.time += state.speed * passed;   // else the engine lags
  ask();
  draw();
  requestAnimationFrame(tick);
}
function play(on) {
  const began = on && !state.playing;
  state.playing = on;
  $("play").textContent = on ? "❚❚" : "▶";
  $("play").setAttribute("aria-label", on ? "pause" : "play");
  if (began) { last = performance.now(); requestAnimationFrame(tick); }
}
function one() { play(false); state.time = (Math.floor(state.time / state.h + 1e-6) + 1) * state.h; ask(); draw(); }
function speeds() {
  const spin = turnRateOf(BLOCK);   // a body at rest moves by 60 steps a second
  state.speed = listSpeeds(spin > 0 ? SHOWN_RATE / spin : 60 * DATA.h);
}

const shownValue = (slider, value) => `${nice(+(slider.shown * value).toPrecision(4))} ${slider.unit}`;
function tell(words) { $("told").textContent = words; }

function sliders() {
  $("sliders").replaceChildren(...SLIDERS.map(slider => {
    const label = html("label", { title: slider.name }, ""), out = html("output", {});
    const input = html("input", { type: "range", min: 0, max: 1000, step: 1, "aria-label": slider.name });
    label.append(html("span", {}, slider.label), input, out);
    const show = () => { out.textContent = shownValue(slider, slider.value); };
    slider.set = value => {
      slider.value = value;
      slider.low = Math.min(slider.low, value); slider.high = Math.max(slider.high, value);
      input.value = Math.round(1000 * (value - slider.low) / (slider.high - slider.low));
      show();
    };
    // a slider has 1,000 places. With Shift, or `fine`, it moves by a tenth of the way from where that began
    const at = place => slider.low + (slider.high - slider.low) * place / 1000;
    let shift = false, from = null;
    const move = (value, digits) => { slider.value = +value.toPrecision(digits); show(); begin(); };
    input.addEventListener("input", () => {
      const place = Number(input.value);
      if (!shift && !$("fine").checked) { from = null; return move(at(place), 4); }
      from ??= { place, value: slider.value };
      move(clamp(from.value + 0.1 * (at(place) - at(from.place)), slider.low, slider.high), 6);
    });
    for (const kind of ["pointerdown", "pointermove"]) input.addEventListener(kind, event => {
      if (kind === "pointerdown" || shift !== event.shiftKey) from = null;
      shift = event.shiftKey;
    });
    input.addEventListener("keydown", event => {
      const way = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[event.key];
      if (!way) return;
      event.preventDefault();
      const step = (slider.high - slider.low) / (event.shiftKey || $("fine").checked ? 1e4 : 1e3);
      slider.set(+clamp(slider.value + way * step, slider.low, slider.high).toPrecision(6));
      begin();
    });
    // after the mouse the keys are the page's again
    input.addEventListener("pointerup", () => { slider.set(slider.value); input.blur(); });
    // a swipe that scrolls the page begins by a touch, which moves the slider that it meets
    let before;
    input.addEventListener("pointerdown", () => { before = slider.value; });
    input.addEventListener("pointercancel", () => { if (slider.value !== before) { slider.set(before); begin(); } });
    slider.set(slider.value);
    return label;
  }));
  $("sliders").onsubmit = event => event.preventDefault();
}

// the address of this motion: moved sliders, members, pictures, and the time
function hash() {
  const parts = SLIDERS.filter(isMoved).map(s => [s.name, s.value]);
  for (const id of PICKED) parts.push([id, $(id).value]);
  parts.push(["t", +state.time.toPrecision(12)]);
  return parts.map(pair => pair.map(encodeURIComponent).join("=")).join("&");
}
const PICKED = ["space", "inside", "quantity", "phase", "members", "speed"];
function restore() {
  let time = 0;
  const bad = [], told = text => text.slice(0, 40);   // of other people's links
  for (const [name, text] of new URLSearchParams(location.hash.slice(1))) {
    const slider = SLIDERS.find(s => s.name === name), number = text.trim() ? Number(text) : NaN;
    if (slider && isFinite(number)) {
      const value = clamp(number, Math.min(slider.low, slider.given), Math.max(slider.high, slider.given));
      if (value !== number) bad.push(`${name} = ${told(text)} is beyond its slider: set to ${nice(value)}`);
      slider.set(value);
    } else if (PICKED.includes(name) && [...$(name).options].some(o => o.value === text)) $(name).value = text;
    else if (name === "t" && number >= 0 && isFinite(number)) time = number;
    else bad.push(slider || PICKED.includes(name) || name === "t" ? `${name} = ${told(text)} is not possible here` : `this page has no ${told(name)}`);
  }
  state.members = Number($("members").value);
  return { time, told: bad.length ? `The link is not that of this page: ${bad.join("; ")}.` : "" };
}
function download() {
  const { text, lost } = savedScene(), moved = lost.map(s => `${s.label}, moved by ${shownValue(s, s.value - s.given)}`);
  if (state.why) return tell(`This motion cannot be saved as a scene. ${state.why}`);
  if (!text) return tell("This motion cannot be saved as a scene: its members come from the rows of a table. One member can be saved.");
  tell(lost.length ? `The saved scene leaves out ${moved.join("; ")}: no distribution in a file says it.${DATA.isIndependent ? " With one member the file has the number." : ""}` : "");
  const link = html("a", { href: URL.createObjectURL(new Blob([text], { type: "application/toml" })), download: `${DATA.source}.toml` });
  link.click();
  URL.revokeObjectURL(link.href);
}
function choose(id, words, value) {
  listOptions(id, Object.entries(words).map(([key, word]) => [key, Array.isArray(word) ? word[0] : word]));
  $(id).value = value;
  $(id).onchange = () => draw();
}

// keys that sliders and checkboxes keep while they have the focus
const NATIVE = { range: /^(Arrow|Home|End|Page)/, checkbox: /^ $/ };

function start() {
  choose("space", SPACE, "body"); choose("inside", INSIDE, "momentum");
  choose("quantity", QUANTITIES, DATA.isFree ? "omega" : "theta"); choose("phase", PHASES, DATA.isFree ? "omega23" : "theta");
  const many = [1, 10, 100, 1000].filter(n => n < DATA.engine.members).concat(DATA.engine.members);
  listOptions("members", many.map(n => [n, n.toLocaleString("en")]));
  $("many").hidden = DATA.engine.members === 1;
  $("members").value = state.members = many.at(-1);
  stages = { body: new Stage($("body"), -0.95, 0.32, 1.6, draw), sphere: new Stage($("sphere"), 0.62, 0.42, 1.5, draw) };
  charts = { motion: new Chart($("motion")), portrait: new Chart($("portrait")), drift: new Chart($("drift")) };
  sliders();
  speeds();
  const { time, told } = restore();
  state.speed = Number($("speed").value);
  $("members").onchange = event => { state.members = Number(event.target.value); begin(); };
  $("speed").onchange = event => {
    state.speed = Number(event.target.value);
    if (parent !== window) parent.postMessage({ speed: state.speed, isPicked: true }, "*");
  };
  for (const box of document.querySelectorAll("#controls input")) {
    box.onchange = () => draw();
    box.onpointerup = () => box.blur();
  }
  $("torque").hidden = DATA.isFree;
  const isTop = DATA.gravity !== null && topOf()?.spin, has = (kind, place) => byPlace(kind, place) !== undefined;
  // without a slider omega_1 stays 0: the push is all of omega_2 where axis 1 is level
  const isLevel = isTop && !has("angle", 2) && !spinOf(0)[0] && !Math.sin(topOf().psi);
  const words = isTop && (has("spin", 0) || isLevel) && has("spin", 1) ? [...Object.keys(PRESETS), ...(has("spin", 2) && has("angle", 1) ? ["sleeping"] : [])] : [];
  $("presets").replaceChildren(...words.map(word => html("button", { type: "button" }, word)));
  for (const button of $("presets").children) button.onclick = () => setPreset(button.textContent);
  $("play").onclick = () => play(!state.playing);
  $("on").onclick = one;
  $("again").onclick = () => begin();
  $("reset").onclick = () => { for (const s of SLIDERS) s.set(s.given); begin(); };
  $("link").hidden = location.protocol === "about:";   // a page within another has no address
  // two pages side by side have one speed, which the page around them sends
  if (parent !== window) parent.postMessage({ speed: state.speed }, "*");
  addEventListener("message", ({ source, data }) => {
    if (source !== parent || !(data.speed > 0)) return;
    if (![...$("speed").options].some(o => Number(o.value) === data.speed)) $("speed").append(html("option", { value: data.speed }, `× ${nice(data.speed)}`));
    $("speed").value = state.speed = data.speed;
  });
  $("link").onclick = async () => {
    location.hash = hash();
    try { await navigator.clipboard.writeText(location.href); } catch { /* the address bar has it */ }
  };
  $("save").onclick = download;
  // a key pressed here reaches the page beside this one, and after Space both play or both rest
  const both = (key, act) => sent => { act(sent); if (!sent && parent !== window) parent.postMessage({ key, isPlaying: state.playing }, "*"); };
  onKeys({ " ": both(" ", sent => play(sent?.isPlaying ?? !state.playing)), ArrowRight: both("ArrowRight", one), Home: both("Home", () => begin()), d: () => $("dark").click(), r: () => $("reset").click(),
    l: () => $("link").click(), s: download }, ({ target, key }) => NATIVE[target.type]?.test(key));
  onResize(draw);
  followTheme(draw);
  begin(time);
  if (told) tell(told);
  try {
    worker = new Worker(URL.createObjectURL(new Blob([$("worker").textContent], { type: "text/javascript" })));
    worker.onmessage = receive;
    worker.onerror = event => fail(event.message);
    const { variants, ...about } = DATA.engine;
    worker.postMessage({ about, variants: variants.map(v => ({ ...v, fast: bytes(v.fast), exact: bytes(v.exact), image: bytes(v.image) })) });
  } catch (error) {
    fail(String(error));
  }
  // a page that moves at once, unless the reader's system asks for less motion
  play(!matchMedia("(prefers-reduced-motion: reduce)").matches && !time);
}
start();
