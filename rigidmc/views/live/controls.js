// ---- the reader's hands ----------------------------------------------------------------------

let last;
function tick(now) {
  if (!state.playing) return;
  const passed = Math.min(0.1, (now - last) / 1000);   // a hidden page rests
  last = now;
  if (!state.busy) state.time += state.speed * passed;
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
  const spin = spinOf(BLOCK);   // a body at rest moves by 60 steps a second
  state.speed = listSpeeds(spin > 0 ? SHOWN_RATE / spin : 60 * DATA.h);
}

function sliders() {
  $("sliders").replaceChildren(...SLIDERS.map(slider => {
    const label = html("label", { title: slider.name }, ""), out = html("output", {});
    const input = html("input", { type: "range", min: 0, max: 1000, step: 1, "aria-label": slider.name });
    label.append(html("span", {}, slider.label), input, out);
    const show = () => { out.textContent = `${nice(+(slider.shown * slider.value).toPrecision(4))} ${slider.unit}`; };
    slider.set = value => {
      slider.value = value;
      input.value = Math.round(1000 * (value - slider.low) / (slider.high - slider.low));
      show();
    };
    input.addEventListener("input", () => {
      slider.value = +(slider.low + (slider.high - slider.low) * input.value / 1000).toPrecision(4);
      show(); begin();
    });
    // after the mouse the keys are the page's again
    input.addEventListener("pointerup", () => input.blur());
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
  for (const [name, text] of new URLSearchParams(location.hash.slice(1))) {
    const slider = SLIDERS.find(s => s.name === name), number = Number(text);
    if (slider && isFinite(number)) slider.set(clamp(number, Math.min(slider.low, slider.given), Math.max(slider.high, slider.given)));
    else if (PICKED.includes(name) && [...$(name).options].some(o => o.value === text)) $(name).value = text;
    else if (name === "t" && number > 0) time = number;
  }
  state.members = Number($("members").value);
  return time;
}
// the scene with the sliders' values, in the words of Python: they stand where the marks are
function scene() {
  const kept = SLIDERS.filter(s => isMoved(s) && !Object.keys(s.marks).length);
  const notes = kept.map(s => `# ${s.name}: the page moved it by ${nice(+(s.value - s.given).toPrecision(4))}, this file does not\n`);
  const text = SLIDERS.flatMap(s => Object.entries(s.marks).map(([mark, own]) => [mark, moved(s, own)]))
    .reduce((text, [mark, value]) => text.replaceAll(mark, String(value)), DATA.scene);
  return notes.join("") + text;
}
function download() {
  const link = html("a", { href: URL.createObjectURL(new Blob([scene()], { type: "application/toml" })), download: `${DATA.source}.toml` });
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
  const time = restore();
  state.speed = Number($("speed").value);
  $("members").onchange = event => { state.members = Number(event.target.value); begin(); };
  $("speed").onchange = event => { state.speed = Number(event.target.value); };
  $("trace").onchange = () => draw();
  $("trace").onpointerup = () => $("trace").blur();
  $("play").onclick = () => play(!state.playing);
  $("on").onclick = one;
  $("again").onclick = () => begin();
  $("reset").onclick = () => { for (const s of SLIDERS) s.set(s.given); begin(); };
  $("link").onclick = async () => {
    location.hash = hash();
    try { await navigator.clipboard.writeText(location.href); } catch { /* the address bar has it */ }
  };
  $("save").onclick = download;
  onKeys({ " ": () => play(!state.playing), ArrowRight: one, Home: () => begin(), d: () => $("dark").click(), r: () => $("reset").click(),
    l: () => $("link").click(), s: download }, ({ target, key }) => NATIVE[target.type]?.test(key));
  onResize(draw);
  followTheme(draw);
  begin(time);
  try {
    worker = new Worker(URL.createObjectURL(new Blob([$("worker").textContent], { type: "text/javascript" })));
    worker.onmessage = receive;
    worker.onerror = event => fail(event.message);
    const { fast, exact, image, ...about } = DATA.engine;
    worker.postMessage({ about, fast: bytes(fast), exact: bytes(exact), image: bytes(image) });
  } catch (error) {
    fail(String(error));
  }
  // a page that moves at once, unless the reader's system asks for less motion
  play(!matchMedia("(prefers-reduced-motion: reduce)").matches && !time);
}
start();
