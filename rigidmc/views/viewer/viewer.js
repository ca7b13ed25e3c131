"use strict";
const $ = id => document.getElementById(id);
// Names may come from other people's files: insert them as text, never as code of the page.
function filled(made, attributes, text) {
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== undefined) made.textContent = text;
  return made;
}
const html = (tag, attributes, text) => filled(document.createElement(tag), attributes, text);
const svg = (tag, attributes, text) => filled(document.createElementNS("http://www.w3.org/2000/svg", tag), attributes, text);
const DATA = JSON.parse($("data").textContent);
const TRAIL = 1500;         // visible frames of the trace of axis 3
const SHOWN_RATE = 3;       // initial turn rate of the body on the screen [rad/s]
const COLOURS = ["var(--one)", "var(--two)", "var(--three)"];
const DASHES = ["", "7 3", "2 3"];

const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
const floats = array => array.f4 ? new Float32Array(bytes(array.f4).buffer)
  : Float32Array.from(new Int16Array(bytes(array.i2).buffer), x => x / 32767);
const clamp = (x, low, high) => Math.min(high, Math.max(low, x));
const sized = (v, size) => { const n = Math.hypot(...v) || 1; return v.map(x => x * size / n); };

for (const m of DATA.members) {
  m.frames = m.q.shape[0];
  for (const key of ["q", "u", "size", "radius"]) if (m[key]) m[key] = floats(m[key]);
  if (m.drift) for (const key of ["t", "energy_drift", "l2_drift"]) m.drift[key] = floats(m.drift[key]);
}
if (DATA.density) {
  DATA.density.t = floats(DATA.density.t);
  DATA.density.bytes = bytes(DATA.density.bytes);
}

// ---- the motion between frames -------------------------------------------------------------

// components of row i + w of an array with `width` columns
function between(array, width, i, w) {
  const j = Math.min(i + 1, array.length / width - 1), row = [];
  for (let k = 0; k < width; k++)
    row.push((1 - w) * array[width * i + k] + w * array[width * j + k]);
  return row;
}

// the rows of the rotation matrix of a quaternion
function matrix([w, x, y, z]) {
  return [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
          [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
          [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]];
}

const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

// m.axes: the described axes in the principal axes, where they differ
const inner = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
function described(m, v) {
  return m.axes ? m.axes.map(axis => inner(axis, v)) : v;
}
// the rotation matrix of the described axes, from that of the principal axes
function describedTurn(m, turn) {
  return m.axes ? turn.map(row => m.axes.map(axis => inner(row, axis))) : turn;
}
// a rotation that takes axis 3 to a unit vector
function along(d) {
  const k = d.map(Math.abs).indexOf(Math.min(...d.map(Math.abs)));
  const e = [0, 0, 0]; e[k] = 1;
  const one = sized(cross(e, d), 1), two = cross(d, one);
  return [0, 1, 2].map(i => [one[i], two[i], d[i]]);
}

const times = (m, v) => m.map(row => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]);

function stateAt(m, t) {
  const place = clamp(t / m.end, 0, 1) * (m.frames - 1);
  const i = Math.min(Math.floor(place), Math.max(m.frames - 2, 0)), w = place - i;
  const q = sized(between(m.q, 4, i, w), 1), u = sized(between(m.u, 3, i, w), 1);
  return { i, w, q, u, size: between(m.size, 1, i, w)[0], turn: matrix(q) };
}

// ---- the two stages ------------------------------------------------------------------------

class Stage {
  static async load(name) {
    const stage = new Stage();
    stage.node = $(name);
    stage.k3d = await k3d.CreateK3DAndLoadBinarySnapshot(bytes(DATA.plots[name]), stage.node);
    stage.world = stage.k3d.getWorld();
    // labels of a grid that is not shown: thousands of elements
    stage.world.overlayDOMNode.remove();
    stage.objects = {};
    for (const [id, object] of Object.entries(stage.world.ObjectsById)) {
      const name = stage.world.ObjectsListJson[id].name;
      object.matrixAutoUpdate = false;
      object.frustumCulled = false;
      (stage.objects[name] ||= []).push(object);
    }
    stage.tags = {};
    stage.stale = true;
    stage.flatten();
    return stage;
  }
  // Unlit materials: with physical ones, a software renderer takes 5 times as long;
  // `shade` puts the light into the colours of corners.
  flatten() {
    const all = [];
    this.world.scene.traverse(object => { if (object.material) all.push(object); });
    const unlit = all.find(object => object.isLine).material;
    for (const object of all.filter(object => object.isMesh)) {
      const own = object.material, coloured = Boolean(object.geometry.attributes.color);
      object.material = unlit.clone();
      object.material.side = own.side;
      object.material.vertexColors = coloured;
      object.material.color.copy(coloured ? unlit.color.clone().setHex(0xffffff) : own.color);
    }
  }
  // the points of a line, n of them
  fill(name, n, point) {
    this.objects[name][0].traverse(o => {
      if (!o.geometry) return;
      const { position } = o.geometry.attributes;
      for (let i = 0; i < n; i++) position.array.set(point(i), 3 * i);
      position.needsUpdate = true;
      o.geometry.setDrawRange(0, n);
    });
    this.stale = true;
  }
  // the body of a member: maps the loaded corners by x -> F x + shift
  form(name, form) {
    this.objects[name][0].traverse(o => {
      if (!o.isMesh) return;
      const { position, color } = o.geometry.attributes;
      o.own ||= Float32Array.from(position.array);
      o.tones ||= Float32Array.from(color.array);
      const rows = [0, 4, 8].map(k => form.slice(k, k + 4)), n = o.own.length / 9;
      for (let i = 0; i < o.own.length; i += 3)
        rows.forEach((f, k) => { position.array[i + k] = f[0] * o.own[i] + f[1] * o.own[i + 1] + f[2] * o.own[i + 2] + f[3]; });
      position.needsUpdate = true;
      o.normals = new Float32Array(3 * n);
      const p = position.array, edge = (k, to) => [0, 1, 2].map(i => p[9 * k + to + i] - p[9 * k + i]);
      for (let k = 0; k < n; k++) o.normals.set(sized(cross(edge(k, 3), edge(k, 6)), 1), 3 * k);
    });
  }
  // set rotation (rows), scale and place of the objects with a name
  move(name, turn, size = 1, at = [0, 0, 0]) {
    for (const object of this.objects[name] || []) {
      object.matrix.set(
        size * turn[0][0], size * turn[0][1], size * turn[0][2], at[0],
        size * turn[1][0], size * turn[1][1], size * turn[1][2], at[1],
        size * turn[2][0], size * turn[2][1], size * turn[2][2], at[2], 0, 0, 0, 1);
      object.matrixWorldNeedsUpdate = true;
    }
  }
  show(family) {
    for (const [name, objects] of Object.entries(this.objects)) {
      const owner = name.split("/");
      if (owner.length > 1) for (const o of objects) o.visible = Number(owner[0]) === family;
    }
    this.stale = true;
  }
  // show words, or a dot, at a point in space; in a separate element, whose motion repaints nothing
  tag(words, at, colour = "", shift = 0) {
    let tag = this.tags[words];
    if (!tag) {
      tag = this.tags[words] = document.createElement("span");
      tag.className = words ? "tag" : "tag dot";
      tag.textContent = words;
      tag.style.color = colour;
      this.node.append(tag);
    }
    this.world.camera.updateMatrixWorld();
    const p = this.world.camera.position.clone().set(...at).project(this.world.camera);
    const x = shift + (0.5 + 0.5 * p.x) * this.node.clientWidth, y = (0.5 - 0.5 * p.y) * this.node.clientHeight;
    tag.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -50%)`;
    return tag;
  }
  // whether the unit ball hides a point on or outside it
  hides(p) {
    const { x, y, z } = this.world.camera.position, far = Math.hypot(x, y, z);
    const along = (p[0] * x + p[1] * y + p[2] * z) / far, beside = Math.sqrt(Math.max(0, Math.hypot(...p) ** 2 - along ** 2));
    return along < 1 / far && beside < 1;
  }
  render() {
    const { renderer, scene, camera } = this.world;
    renderer.clear();
    renderer.render(scene, camera);
    this.stale = false;
  }
  // a software renderer needs about 15 ms per picture: draw the sphere only when it changes
  renderIfStale() {
    const seen = this.world.camera.matrixWorld.elements.join();
    if (this.stale !== false || seen !== this.seen) this.render();
    this.seen = seen;
  }
  get eye() {
    const { matrixWorld, projectionMatrix } = this.world.camera;
    return [...matrixWorld.elements, ...projectionMatrix.elements].join();
  }
  paper(dark) { this.k3d.setClearColor(dark ? 0x16181c : 0xffffff); this.stale = true; }
}

// Replaces a stage if the browser lacks WebGL, which the charts do not need.
class Blank {
  constructor(name) {
    $(name).textContent = "This picture needs WebGL 2, which this browser lacks or has disabled.";
    $(name).classList.add("blank");
    this.objects = { body: [], trace: [], globe: [] };
  }
  fill() {} form() {} move() {} show() {} render() {} renderIfStale() {} paper() {}
  tag() { return { style: {} }; }
  hides() { return false; }
  get eye() { return ""; }
}

// Light a body: the brightness of each triangle follows its angle to the lamp. Corners come in threes.
const LAMP = sized([0.5, -0.6, 0.8], 1);
function shade(stage, name, turn) {
  const lamp = [0, 1, 2].map(k => turn[0][k] * LAMP[0] + turn[1][k] * LAMP[1] + turn[2][k] * LAMP[2]);
  for (const object of stage.objects[name]) object.traverse(o => {
    if (!o.isMesh) return;
    const { color } = o.geometry.attributes, n = o.normals.length / 3;
    for (let k = 0; k < n; k++) {
      const toward = o.normals[3 * k] * lamp[0] + o.normals[3 * k + 1] * lamp[1] + o.normals[3 * k + 2] * lamp[2];
      const light = 0.65 + 0.35 * Math.max(0, toward);
      for (let c = 9 * k; c < 9 * k + 9; c++) color.array[c] = light * o.tones[c];
    }
    color.needsUpdate = true;
  });
}

const RAMP = [[0.91, 0.91, 0.91], [0.42, 0.68, 0.84], [0.03, 0.19, 0.42]];
function ramp(x) {
  const k = x < 0.5 ? 0 : 1, w = 2 * x - k;
  return RAMP[k].map((low, i) => (1 - w) * low + w * RAMP[k + 1][i]);
}
const TABLE = Array.from({ length: 256 }, (_, i) => ramp(i / 255));
const EVEN = { t: [0], bytes: new Uint8Array(1200) };  // the globe without a density
let painted = -1;
function paint(stage, t) {
  const d = DATA.density || EVEN;
  let k = 0;
  while (k + 1 < d.t.length && d.t[k + 1] <= t * (1 + 1e-6)) k++;
  if (k === painted) return;
  painted = k;
  for (const globe of stage.objects.globe) globe.traverse(object => {
    const colour = object.geometry && object.geometry.attributes.color;
    if (!colour) return;
    const n = d.bytes.length / d.t.length, at = object.geometry.attributes.position.array;
    for (let i = 0; i < n; i++) {
      const light = 0.85 + 0.15 * (at[3 * i] * LAMP[0] + at[3 * i + 1] * LAMP[1] + at[3 * i + 2] * LAMP[2]);
      for (let c = 0; c < 3; c++) colour.array[3 * i + c] = light * TABLE[d.bytes[k * n + i]][c];
    }
    colour.needsUpdate = true;
  });
  stage.stale = true;
}

// ---- charts --------------------------------------------------------------------------------

function ticks(low, high, count) {
  const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
  const step = power * ([1, 2, 5, 10].find(s => s * power >= raw));
  const list = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) list.push(k * step);
  return list;
}
const nice = x => x === 0 ? "0" : Math.abs(x) >= 1e5 || Math.abs(x) < 1e-3
  ? (+x.toPrecision(6)).toExponential().replace("e+", "e") : String(+x.toPrecision(6));

// indices of the smallest and the largest value in each of several sections
function thinned(values, most) {
  const n = values.length, stretch = Math.ceil(2 * n / most);
  if (stretch <= 2) return Array.from(values.keys());
  const list = [];
  for (let i = 0; i < n; i += stretch) {
    let low = i, high = i;
    for (let j = i; j < Math.min(i + stretch, n); j++) {
      if (values[j] < values[low]) low = j;
      if (values[j] > values[high]) high = j;
    }
    list.push(Math.min(low, high), Math.max(low, high));
  }
  return list;
}

class Chart {
  constructor(id, log) { this.svg = $(id); this.log = log; }
  draw(end, t, series) {
    const width = this.svg.clientWidth || 600, height = this.svg.clientHeight || 190;
    this.left = 56; this.right = width - 8; this.end = end;
    const top = 6, bottom = height - 20;
    let low = Infinity, high = -Infinity;
    for (const s of series) for (const y of s.values) if (isFinite(y)) { low = Math.min(low, y); high = Math.max(high, y); }
    if (low > high) { low = 0; high = 1; }
    if (this.log) { low = Math.floor(low); high = Math.max(Math.ceil(high), low + 1); }
    else if (high - low < 1e-9 * Math.max(Math.abs(high), Math.abs(low), 1e-30)) { const d = Math.abs(high) * 0.1 || 1; low -= d; high += d; }
    const x = s => this.left + (this.right - this.left) * s / end;
    const y = v => bottom - (bottom - top) * (v - low) / (high - low);
    const parts = [];
    const every = this.log ? Math.max(1, Math.ceil((high - low) / 4)) : 0;
    const marks = this.log ? Array.from({ length: Math.floor((high - low) / every) + 1 }, (_, k) => low + k * every) : ticks(low, high, 4);
    for (const v of marks)
      parts.push(svg("line", { class: "rule", x1: this.left, x2: this.right, y1: y(v), y2: y(v) }),
        svg("text", { x: this.left - 5, y: y(v) + 4, "text-anchor": "end" }, this.log ? (v <= -17 ? "0" : "1e" + v) : nice(v)));
    for (const s of ticks(0, end, width < 500 ? 4 : 7))
      parts.push(svg("text", { x: x(s), y: height - 5, "text-anchor": x(s) > this.right - 16 ? "end" : "middle" }, nice(s)));
    parts.push(svg("text", { x: this.right, y: bottom - 4, "text-anchor": "end" }, "t [s]"));
    series.forEach((s, k) => {
      let d = "";
      for (const i of thinned(s.values, 2 * (this.right - this.left))) d += (d ? "L" : "M") + x(t[i]).toFixed(1) + " " + y(s.values[i]).toFixed(1);
      parts.push(svg("path", { d, style: `stroke:${COLOURS[k]}`, "stroke-dasharray": DASHES[k] }));
    });
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.svg.replaceChildren(...parts);
  }
  cursor(t) {
    const x = this.left + (this.right - this.left) * t / this.end;
    this.svg.nextElementSibling.style.transform = `translateX(${x.toFixed(1)}px)`;
  }
  onPick(seek) {
    const pick = event => {
      const box = this.svg.getBoundingClientRect();
      seek(this.end * clamp((event.clientX - box.left - this.left) / (this.right - this.left), 0, 1));
    };
    this.svg.addEventListener("pointerdown", event => { this.svg.setPointerCapture(event.pointerId); pick(event); });
    this.svg.addEventListener("pointermove", event => { if (event.buttons) pick(event); });
  }
}

function legend(id, names) {
  $(id).replaceChildren(...names.map((name, k) => html("b", { style: `color:${COLOURS[k]}` }, `${["—", "– –", "···"][k]} ${name}`)));
}

// ---- the map -------------------------------------------------------------------------------

class Pixels {
  constructor(map) {
    this.map = map;
    this.svg = $("pixels");
    [this.columns, this.rows] = map.sides.map(side => side.values.length);
    for (const key of ["good", "failed"]) map[key] = floats(map[key]);
    for (const m of map.measures)
      for (const key of ["places", "values", "low", "high"]) if (m[key]) m[key] = floats(m[key]);
    $("map").hidden = false;
    $("pick").hidden = true;
    $("drifting").hidden = true;
    $("measure").replaceChildren(...map.measures.map((m, k) => html("option", { value: k }, m.name)));
    $("measure").onchange = () => this.draw();
    this.svg.addEventListener("pointermove", event => this.tell(...this.at(event)));
    this.svg.addEventListener("click", event => this.pick(...this.at(event)));
    this.draw();
  }
  get measure() { return this.map.measures[Number($("measure").value) || 0]; }
  // the edge of pixel k of a side, in its own units; log-spaced if the side is logarithmic
  edge(side, k) {
    const scale = side.log ? Math.log : x => x, back = side.log ? Math.exp : x => x;
    const low = scale(side.values[0]), n = side.values.length;
    const step = n > 1 ? (scale(side.values[n - 1]) - low) / (n - 1) : 1;
    return back(low + (k - 0.5) * step);
  }
  picture() {
    const canvas = document.createElement("canvas"), m = this.measure;
    canvas.width = this.columns; canvas.height = this.rows;
    const context = canvas.getContext("2d"), image = context.createImageData(this.columns, this.rows);
    for (let i = 0; i < this.rows; i++) for (let j = 0; j < this.columns; j++) {
      const p = i * this.columns + j, place = m.places[p];
      const none = this.map.good[p] + this.map.failed[p] === 0;
      const colour = this.map.failed[p] > 0 ? [166, 28, 0] : none ? [255, 255, 255]
        : isNaN(place) ? [221, 221, 221] : m.colours[clamp(Math.round(255 * place), 0, 255)];
      image.data.set([...colour, 255], 4 * ((this.rows - 1 - i) * this.columns + j));
    }
    context.putImageData(image, 0, 0);
    return canvas.toDataURL();
  }
  draw() {
    const width = this.svg.clientWidth || 600, height = this.svg.clientHeight || 420, m = this.measure;
    this.box = { left: 60, top: 6, right: width - 86, bottom: height - 38 };
    const { left, top, right, bottom } = this.box;
    const parts = [svg("image", { href: this.picture(), x: left, y: top, width: right - left, height: bottom - top,
      preserveAspectRatio: "none", style: "image-rendering: pixelated" })];
    this.map.sides.forEach((side, k) => {
      const n = side.values.length, low = this.edge(side, 0), high = this.edge(side, n);
      const scale = side.log ? Math.log : x => x;
      const marks = side.log ? ticks(Math.log10(low), Math.log10(high), 5).map(e => 10 ** e) : ticks(low, high, 5);
      for (const v of marks) {
        const share = (scale(v) - scale(low)) / (scale(high) - scale(low));
        const at = k ? { x: left - 5, y: bottom - share * (bottom - top) + 4, "text-anchor": "end" }
          : { x: left + share * (right - left), y: bottom + 15, "text-anchor": "middle" };
        parts.push(svg("text", at, nice(+v.toPrecision(3))));
      }
    });
    const [x, y] = this.map.sides, middle = (top + bottom) / 2;
    parts.push(svg("text", { x: (left + right) / 2, y: height - 4, "text-anchor": "middle" }, x.name),
      svg("text", { x: 12, y: middle, "text-anchor": "middle", transform: `rotate(-90 12 ${middle})` }, y.name));
    for (let k = 0; k < 64; k++) {
      const h = (bottom - top) / 64;
      parts.push(svg("rect", { x: right + 14, y: bottom - (k + 1) * h, width: 14, height: h + 0.5, fill: `rgb(${m.colours[4 * k + 2]})` }));
    }
    parts.push(svg("text", { x: right + 32, y: bottom }, nice(+m.range[0].toPrecision(3))),
      svg("text", { x: right + 32, y: top + 10 }, nice(+m.range[1].toPrecision(3))),
      svg("circle", { id: "here", r: 6, style: "fill: none; stroke: var(--path); stroke-width: 3" }));
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.svg.replaceChildren(...parts);
    this.mark();
  }
  at(event) {
    const frame = this.svg.getBoundingClientRect(), { left, top, right, bottom } = this.box;
    const j = Math.floor(this.columns * (event.clientX - frame.left - left) / (right - left));
    const i = Math.floor(this.rows * (bottom - (event.clientY - frame.top)) / (bottom - top));
    return [clamp(i, 0, this.rows - 1), clamp(j, 0, this.columns - 1)];
  }
  words(i, j) {
    const m = this.measure, p = i * this.columns + j, [x, y] = this.map.sides;
    const say = v => isFinite(v) ? +v.toPrecision(4) : "open";
    const units = m.units && " " + m.units;
    const middle = m.values[p] === Infinity ? "beyond the end" : say(m.values[p]) + units;
    const value = isNaN(m.values[p]) ? "none" : middle +
      (m.low && !isNaN(m.low[p]) ? ` [${say(m.low[p])}, ${say(m.high[p])}]` : "");
    return `${x.name.split(" ")[0]} = ${say(x.values[j])}, ${y.name.split(" ")[0]} = ${say(y.values[i])}: ${value}, ` +
      `${this.map.good[p]} of ${this.map.members}`;
  }
  tell(i, j) { $("pixel").textContent = this.words(i, j); }
  // show the member of the nearest pixel that has one
  pick(i, j) {
    let best = 0;
    const far = k => Math.hypot((DATA.members[k].pixel[0] - i) / this.rows, (DATA.members[k].pixel[1] - j) / this.columns);
    for (let k = 1; k < DATA.members.length; k++) if (far(k) < far(best)) best = k;
    page.t = 0;
    choose(best);
  }
  mark() {
    const [i, j] = DATA.members[page.member].pixel, { left, top, right, bottom } = this.box;
    $("here").setAttribute("cx", left + (right - left) * (j + 0.5) / this.columns);
    $("here").setAttribute("cy", bottom - (bottom - top) * (i + 0.5) / this.rows);
    this.tell(i, j);
  }
}

// ---- the page ------------------------------------------------------------------------------

const page = { t: 0, member: 0, playing: false, speed: 1, frames: 0 };
const charts = { motion: new Chart("motion", false), drift: new Chart("drift", true) };
const NAMES = { theta: ["θ"], omega: ["ω₁", "ω₂", "ω₃"], euler: ["φ", "θ", "ψ"], u: ["1", "2", "3"] };
let stages, pixels;

const degrees = x => x * 180 / Math.PI;
const VALUES = {
  theta: (m, i) => VALUES.euler(m, i, 1),
  u: (m, i, k) => described(m, [0, 1, 2].map(j => m.u[3 * i + j]))[k],
  omega: (m, i, k) =>
    described(m, [0, 1, 2].map(j => m.largest * m.size[i] * m.u[3 * i + j] / m.moments[j]))[k],
  // TdC (3.36): axis 3 of the body in space has the polar angles theta and phi - 90 degrees
  euler: (m, i, k) => {
    const a = describedTurn(m, matrix(m.q.subarray(4 * i, 4 * i + 4)));
    return degrees(k === 1 ? Math.acos(clamp(a[2][2], -1, 1))
      : k === 0 ? Math.atan2(a[0][2], -a[1][2]) : Math.atan2(a[2][0], a[2][1]));
  },
};
function unwrap(values) {
  for (let i = 1; i < values.length; i++) values[i] -= 360 * Math.round((values[i] - values[i - 1]) / 360);
}
function quantity() {
  const m = DATA.members[page.member], key = $("quantity").value;
  const t = Array.from({ length: m.frames }, (_, i) => m.end * i / (m.frames - 1 || 1));
  const series = NAMES[key].map((_, k) => ({ values: t.map((_, i) => VALUES[key](m, i, k)) }));
  if (key === "euler") series.forEach(s => unwrap(s.values));
  charts.motion.draw(m.end, t, series);
  legend("names", NAMES[key]);
}
function drifts() {
  const m = DATA.members[page.member];
  if (!m.drift) return;
  const log = values => Array.from(values, v => Math.log10(Math.max(Math.abs(v), 1e-17)));
  charts.drift.draw(m.end, m.drift.t, ["energy_drift", "l2_drift"].map(key => ({ values: log(m.drift[key]) })));
  const kept = key => m.drift.conserved[key].startsWith("no") ? " (not conserved here)" : "";
  legend("drifts", ["energy" + kept("energy_drift"), "|L|²" + kept("l2_drift")]);
}

function draw() {
  const m = DATA.members[page.member], s = stateAt(m, page.t);
  const { body, sphere } = stages;
  body.move("body", s.turn);
  const turn = describedTurn(m, s.turn);
  for (const part of ["axis1", "axis2", "axis3"]) body.move(part, turn);
  const arm = Math.hypot(...m.centre);
  body.move("stick", along(arm > 0 ? sized(times(s.turn, m.centre), 1) : [0, 0, 1]), arm);
  shade(body, "body", s.turn);
  for (const trace of body.objects.trace)
    trace.traverse(o => o.geometry && o.geometry.setDrawRange(Math.max(0, s.i + 1 - TRAIL), Math.min(s.i + 1, TRAIL)));
  const toward = times(s.turn, s.u);
  body.move("momentum", along(sized(toward, 1)), 1.25 * s.size);
  paint(sphere, page.t);
  body.render();
  sphere.renderIfStale();
  for (let a = 0; a < 3; a++) {
    const e = [0, 0, 0]; e[a] = 1.3;
    body.tag(`${a + 1}`, times(turn, e), COLOURS[a]);
    const end = e.map(x => 1.03 * x);
    // polhodes are in the principal axes, whose moments name them where these are not the body's axes
    sphere.tag(m.axes ? "I" + "₁₂₃"[a] : `${a + 1}`, end, COLOURS[a]).style.opacity = sphere.hides(end) ? 0.3 : 1;
  }
  sphere.tag("", s.u).style.opacity = sphere.hides(s.u) ? 0.4 : 1;
  body.tag("L", sized(toward, 1.3 * s.size), "var(--path)", -14);
  body.tag("z", [0, 0, 1.4], "var(--grey)");
  if (m.radius) {
    const out = sized([...between(m.radius, 2, s.i, s.w), 0], 1);
    body.move("radius", along(out), 1.25);
    body.tag("r", out.map(x => 1.33 * x), "var(--weight)");
  }
  for (const [name, word] of [["gravity", "g"], ["field", "B"]])
    if (body.objects[name]) body.tag(word, [1.15, 0, 0.7], "var(--weight)");
  charts.motion.cursor(page.t);
  if (m.drift) charts.drift.cursor(page.t);
  $("slider").value = page.t / m.end;
  $("clock").textContent = `${page.t.toPrecision(4)} s`;
}

function seek(t) { page.t = clamp(t, 0, DATA.members[page.member].end); draw(); }
function step(n) {
  const m = DATA.members[page.member], h = m.end / (m.frames - 1 || 1);
  play(false);
  seek((Math.round(page.t / h) + n) * h);
}
let last;
function tick(now) {
  if (!page.playing) return;
  const m = DATA.members[page.member];
  page.t += page.speed * (now - last) / 1000;
  last = now;
  if (page.t > m.end) page.t = m.end > 0 ? page.t % m.end : 0;
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
function speeds() {
  const m = DATA.members[page.member], wanted = m.rate > 0 ? SHOWN_RATE / m.rate : 1;
  const list = [];
  for (let p = -6; p <= 6; p++) for (const s of [1, 2, 5]) list.push(+(s * 10 ** p).toPrecision(1));
  const near = list.reduce((a, b) => Math.abs(Math.log(b / wanted)) < Math.abs(Math.log(a / wanted)) ? b : a);
  const at = list.indexOf(near);
  $("speed").replaceChildren(...list.slice(Math.max(0, at - 6), at + 8)
    .map(s => html("option", s === near ? { value: s, selected: "" } : { value: s }, `× ${s}`)));
  page.speed = near;
}
function choose(member) {
  page.member = member;
  const m = DATA.members[member], { body, sphere } = stages;
  sphere.show(m.family);
  sphere.fill("path", m.frames, i => m.u.subarray(3 * i, 3 * i + 3).map(x => 1.008 * x));
  body.form("body", m.form);
  body.fill("trace", m.frames, i => describedTurn(m, matrix(m.q.subarray(4 * i, 4 * i + 4))).map(row => 1.2 * row[2]));
  $("note").textContent = `Member ${m.index}: ${m.status === "ok" ? "" : `flagged (${m.status}), frozen at its last good state; `}` +
    `${m.frames.toLocaleString("en")} frames of ${+m.end.toPrecision(4)} s, ${m.steps}` +
    `${m.whole ? "" : "; the run continues after that"}. Drag to rotate, scroll to zoom; space plays, arrows step.`;
  if (pixels) pixels.draw();
  speeds(); quantity(); drifts(); seek(Math.min(page.t, m.end));
}
function dress(dark) {
  document.documentElement.classList.toggle("dark", dark);
  for (const stage of Object.values(stages)) stage.paper(dark);
  draw();
}

async function start() {
  const draws = document.createElement("canvas").getContext("webgl2");
  stages = {};
  for (const name of ["body", "sphere"]) stages[name] = draws ? await Stage.load(name) : new Blank(name);
  $("member").replaceChildren(...DATA.members.map((m, k) =>
    html("option", { value: k }, `${m.index}${m.status === "ok" ? "" : " ⚑ " + m.status}`)));
  $("crowd").textContent = DATA.density ? `Blue: density of ${DATA.density.members.toLocaleString("en")} members.` : "";
  const pulls = [["radius", "local vertical of the orbit (r)"], ["gravity", "gravity"], ["field", "field"]]
    .filter(([name]) => stages.body.objects[name]).map(([, words]) => words);
  document.querySelector(".weight").textContent = pulls.length ? `Green: ${pulls.join(", ")}.` : "";
  $("member").onchange = event => choose(Number(event.target.value));
  $("speed").onchange = event => { page.speed = Number(event.target.value); };
  $("quantity").onchange = () => { quantity(); draw(); };
  $("slider").oninput = event => seek(event.target.value * DATA.members[page.member].end);
  $("play").onclick = () => play(!page.playing);
  $("back").onclick = () => step(-1);
  $("on").onclick = () => step(1);
  $("dark").onclick = () => dress(!document.documentElement.classList.contains("dark"));
  for (const chart of Object.values(charts)) chart.onPick(seek);
  const keys = {
    " ": () => play(!page.playing), ArrowLeft: () => step(-1), ArrowRight: () => step(1),
    Home: () => seek(0), End: () => seek(DATA.members[page.member].end), d: () => $("dark").click(),
  };
  document.addEventListener("keydown", event => {
    if (event.target.tagName === "SELECT" || !(event.key in keys)) return;
    event.preventDefault();
    keys[event.key]();
  });
  // K3D moves its cameras itself
  const eyes = () => Object.values(stages).map(stage => stage.eye).join();
  let seen = "";
  setInterval(() => {
    const now = eyes();
    if (now !== seen && !page.playing) draw();
    seen = now;
  }, 40);
  let waiting;
  addEventListener("resize", () => { clearTimeout(waiting); waiting = setTimeout(() => choose(page.member), 150); });
  $("quantity").value = DATA.quantity;
  if (DATA.map) pixels = new Pixels(DATA.map);
  choose(0);
  const scheme = matchMedia("(prefers-color-scheme: dark)");
  scheme.addEventListener("change", () => dress(scheme.matches));
  dress(scheme.matches);
}
const ready = start();
