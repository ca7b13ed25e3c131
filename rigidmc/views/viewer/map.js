// ---- the map -------------------------------------------------------------------------------

function svg(tag, attributes, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== undefined) made.textContent = text;
  return made;
}

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
    listOptions("measure", map.measures.map((m, k) => [k, m.name]));
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
