// ---- solids and curves on a plain canvas: no library, no WebGL --------------------------------

const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const inner = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const size = v => Math.hypot(...v);
const sized = (v, length) => { const n = size(v) || 1; return v.map(x => x * length / n); };
const times = (rows, v) => rows.map(row => inner(row, v));
const back = (rows, v) => [0, 1, 2].map(k => rows[0][k] * v[0] + rows[1][k] * v[1] + rows[2][k] * v[2]);

// the rows of the rotation matrix of a quaternion
function matrix([w, x, y, z]) {
  return [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
          [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
          [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]];
}

const rgb = name => { const text = colour(name); return [1, 3, 5].map(k => parseInt(text.slice(k, k + 2), 16)); };
const shaded = ([r, g, b], light) => `rgb(${(r * light) | 0},${(g * light) | 0},${(b * light) | 0})`;

// A canvas as wide as its place on the page, in device pixels.
class Canvas {
  constructor(node) {
    this.node = node;
    this.pen = node.getContext("2d");
  }
  clear() {
    const { clientWidth: width, clientHeight: height } = this.node, ratio = window.devicePixelRatio || 1;
    if (this.node.width !== Math.round(width * ratio)) {
      this.node.width = Math.round(width * ratio);
      this.node.height = Math.round(height * ratio);
    }
    this.width = width; this.height = height;
    this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.pen.clearRect(0, 0, width, height);
  }
}

// ---- a stage: what is put on it is drawn from far to near ------------------------------------

const LAMP = sized([0.5, -0.6, 0.8], 1);   // in space
const NEAR = 5;                            // distance of the eye, in units of the stage
class Stage extends Canvas {
  constructor(node, azimuth, height, reach, changed) {
    super(node);
    Object.assign(this, { azimuth, elevation: height, reach, zoom: 1, parts: [] });
    // pointers: their places. The mouse turns the stage. So do two fingers, which zoom it, too; one finger turns it
    // sideways, because a page scrolls by its way up and down
    const held = new Map(), apart = () => { const [a, b] = held.values(); return Math.hypot(a[0] - b[0], a[1] - b[1]); };
    node.addEventListener("pointerdown", event => { held.set(event.pointerId, [event.clientX, event.clientY]); node.setPointerCapture(event.pointerId); });
    for (const end of ["pointerup", "pointercancel"]) node.addEventListener(end, event => { held.delete(event.pointerId); });
    node.addEventListener("pointermove", event => {
      const from = held.get(event.pointerId), to = [event.clientX, event.clientY], many = held.size;
      if (!from) return;
      const before = many === 2 ? apart() : 0;
      held.set(event.pointerId, to);
      if (before > 0) this.zoom = clamp(this.zoom * apart() / before, 0.4, 4);
      this.azimuth -= 0.01 * (to[0] - from[0]) / many;
      if (many > 1 || event.pointerType !== "touch") this.elevation = clamp(this.elevation + 0.01 * (to[1] - from[1]) / many, -1.5, 1.5);
      changed();
    });
    node.addEventListener("wheel", event => {
      event.preventDefault();
      this.zoom = clamp(this.zoom * Math.exp(-0.001 * event.deltaY), 0.4, 4);
      changed();
    }, { passive: false });
    node.addEventListener("keydown", event => {   // a stage with the focus turns by arrows
      const turns = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[event.key];
      if (!turns) return;
      event.preventDefault(); event.stopPropagation();
      this.azimuth += turns[0];
      this.elevation = clamp(this.elevation + turns[1], -1.5, 1.5);
      changed();
    });
  }
  begin() {
    this.clear();
    this.parts = []; this.labels = [];
    const [ca, sa, ce, se] = [Math.cos(this.azimuth), Math.sin(this.azimuth), Math.cos(this.elevation), Math.sin(this.elevation)];
    this.toward = [ca * ce, sa * ce, se];               // unit vector to the eye
    this.right = [-sa, ca, 0];
    this.up = [-ca * se, -sa * se, ce];
    this.scale = 0.5 * Math.min(this.width, this.height) / this.reach * this.zoom;
  }
  // [x, y, depth] on the canvas; depth grows toward the eye
  place(p) {
    const depth = inner(p, this.toward), near = this.scale * NEAR * this.reach / (NEAR * this.reach - depth);
    return [0.5 * this.width + near * inner(p, this.right), 0.5 * this.height - near * inner(p, this.up), depth];
  }
  put(depth, draw) { this.parts.push([depth, draw]); }
  // corners: a flat array of triangles; tones: [r, g, b] of each; form: 3 x 4 to the body's axes; turn: rows
  solid(corners, tones, form, turn, shade = 1) {
    const n = corners.length / 9, m = [0, 1, 2].map(i => [0, 1, 2, 3].map(j =>
      turn[i][0] * form[j] + turn[i][1] * form[4 + j] + turn[i][2] * form[8 + j]));
    for (let i = 0; i < 3; i++) m[i][3] = turn[i][0] * form[3] + turn[i][1] * form[7] + turn[i][2] * form[11];
    const at = k => [0, 1, 2].map(i => m[i][0] * corners[k] + m[i][1] * corners[k + 1] + m[i][2] * corners[k + 2] + m[i][3]);
    for (let k = 0; k < n; k++) {
      const [a, b, c] = [at(9 * k), at(9 * k + 3), at(9 * k + 6)];
      const normal = sized(cross(sub(b, a), sub(c, a)), 1), middle = [0, 1, 2].map(i => (a[i] + b[i] + c[i]) / 3);
      if (inner(normal, sub(this.toward.map(x => x * NEAR * this.reach), middle)) <= 0) continue;
      const light = shade * (0.62 + 0.38 * Math.max(0, inner(normal, LAMP)));
      const [p, q, r] = [this.place(a), this.place(b), this.place(c)], fill = shaded(tones[k], light);
      this.put((p[2] + q[2] + r[2]) / 3, pen => {
        pen.fillStyle = pen.strokeStyle = fill;
        pen.lineWidth = 0.7;
        pen.beginPath(); pen.moveTo(p[0], p[1]); pen.lineTo(q[0], q[1]); pen.lineTo(r[0], r[1]); pen.closePath();
        pen.fill(); pen.stroke();
      });
    }
  }
  // a curve in short pieces, so that solids hide them
  // nearer: how much nearer than it is a curve counts, to lie on a solid rather than in it
  curve(points, style, width = 1.5, alpha = null, nearer = 0) {
    let last = null;
    points.forEach((point, i) => {
      const p = this.place(point), from = last;
      last = p;
      if (!from) return;
      this.put((p[2] + from[2]) / 2 + nearer, pen => {
        pen.globalAlpha = alpha ? alpha(i / points.length) : 1;
        pen.strokeStyle = style; pen.lineWidth = width; pen.lineCap = "round";
        pen.beginPath(); pen.moveTo(from[0], from[1]); pen.lineTo(p[0], p[1]); pen.stroke();
        pen.globalAlpha = 1;
      });
    });
  }
  segment(a, b, style, width = 1.5, pieces = 12) {
    this.curve(Array.from({ length: pieces + 1 }, (_, i) => a.map((x, k) => x + (b[k] - x) * i / pieces)), style, width);
  }
  arrow(a, b, style, width = 3) {
    const along = sub(b, a), far = size(along);
    if (!(far > 1e-9)) return;
    this.segment(a, b, style, width);
    const [p, q] = [this.place(a), this.place(b)], flat = Math.hypot(q[0] - p[0], q[1] - p[1]);
    if (flat < 4) return;
    const u = [(q[0] - p[0]) / flat, (q[1] - p[1]) / flat], s = Math.min(11, 0.5 * flat);
    this.put(q[2] + 0.02, pen => {
      pen.fillStyle = style;
      pen.beginPath(); pen.moveTo(q[0] + 2 * u[0], q[1] + 2 * u[1]);
      pen.lineTo(q[0] - s * u[0] - 0.45 * s * u[1], q[1] - s * u[1] + 0.45 * s * u[0]);
      pen.lineTo(q[0] - s * u[0] + 0.45 * s * u[1], q[1] - s * u[1] - 0.45 * s * u[0]);
      pen.closePath(); pen.fill();
    });
  }
  dot(p, style, radius, edge = null) {
    const q = this.place(p);
    this.put(q[2] + 0.01, pen => {
      pen.fillStyle = style;
      pen.beginPath(); pen.arc(q[0], q[1], radius, 0, 2 * Math.PI); pen.fill();
      if (edge) { pen.strokeStyle = edge; pen.lineWidth = 2; pen.stroke(); }
    });
  }
  // the unit ball, round at the limb, with the density of members on it; `isHidden` says what is behind
  ball(density = null) {
    if (!(this.scale > 0)) return;   // a page that is not shown has no size
    const [x, y] = this.place([0, 0, 0]), far = NEAR * this.reach, radius = this.scale * far / Math.sqrt(far * far - 1);
    const key = [this.azimuth, this.elevation, radius, density && density.k, isDark()].join();
    if (key !== this.painted) this.picture = ballPicture(this, radius, density);
    this.painted = key;
    this.put(-9, pen => {
      pen.save();
      pen.beginPath(); pen.arc(x, y, radius, 0, 2 * Math.PI); pen.clip();
      pen.drawImage(this.picture, x - radius, y - radius, 2 * radius, 2 * radius);
      pen.restore();
    });
  }
  isHidden(p) {
    const along = inner(p, this.toward), far = NEAR * this.reach;
    return along < 1 / far && size(p) ** 2 - along ** 2 < 1;
  }
  // a curve on the unit ball: its far side faint
  onBall(points, style, width = 1.5, faint = 0.18) {
    for (const hidden of [true, false]) this.put(hidden ? -8 : 8, pen => {
      pen.strokeStyle = style; pen.lineWidth = width; pen.lineJoin = "round";
      pen.globalAlpha = hidden ? faint : 1;
      pen.beginPath();
      let drawing = false;
      for (const point of points) {
        const p = this.place(point), here = this.isHidden(point) === hidden;
        if (here && drawing) pen.lineTo(p[0], p[1]); else if (here) pen.moveTo(p[0], p[1]);
        drawing = here;
      }
      pen.stroke();
      pen.globalAlpha = 1;
    });
  }
  label(words, p, style) { this.labels.push([words, this.place(p), style]); }
  end() {
    this.parts.sort((a, b) => a[0] - b[0]);
    for (const [, draw] of this.parts) draw(this.pen);
    const pen = this.pen, taken = this.written = [];
    pen.font = "600 14px system-ui, sans-serif";
    pen.textAlign = "center"; pen.textBaseline = "middle";
    for (const [words, [x, y0], style] of this.labels) {  // labels move apart rather than overlap
      let down = y0 < 30 ? 4 : -4, y = Math.max(y0, 10);
      while (taken.some(([u, v]) => Math.abs(u - x) < 14 && Math.abs(v - y) < 15)) {
        y += down;
        if (y < 10) [y, down] = [Math.max(y0, 10), 4];
      }
      taken.push([x, y]);
      pen.lineWidth = 3; pen.strokeStyle = colour("--paper"); pen.strokeText(words, x, y);
      pen.fillStyle = style; pen.fillText(words, x, y);
    }
  }
}

// ---- the ball --------------------------------------------------------------------------------

// The density of directions at several times: rows from the pole +3 to -3, columns around from axis 1.
class Density {
  constructor({ t, shape, bytes: text }) {
    Object.assign(this, { t, rows: shape[1], columns: shape[2], values: bytes(text), k: 0 });
  }
  at(time) {
    this.k = 0;
    while (this.k + 1 < this.t.length && this.t[this.k + 1] <= time * (1 + 1e-6)) this.k++;
    return this;
  }
  // between the four nearest of the grid, from 0 to 1
  value(x, y, z) {
    const { rows, columns, values } = this, start = this.k * rows * columns;
    const row = Math.acos(clamp(z, -1, 1)) / Math.PI * (rows - 1), column = (Math.atan2(y, x) / (2 * Math.PI) + 1) * columns;
    const i = Math.min(Math.floor(row), rows - 2), v = row - i, j = Math.floor(column), w = column - j;
    const one = start + i * columns, a = j % columns, b = (j + 1) % columns;
    const over = (1 - w) * values[one + a] + w * values[one + b], under = (1 - w) * values[one + columns + a] + w * values[one + columns + b];
    return ((1 - v) * over + v * under) / 255;
  }
}

const FINEST = 420;   // most pixels across the picture of a ball, which the page stretches
function ballPicture(stage, radius, density) {
  const side = Math.min(FINEST, 2 * Math.ceil(radius)), far = NEAR * stage.reach, limb = far / Math.sqrt(far * far - 1);
  const canvas = document.createElement("canvas"), ramp = [rgb("--ball"), rgb("--crowd-middle"), rgb("--crowd")];
  canvas.width = canvas.height = side;
  const pen = canvas.getContext("2d"), image = pen.createImageData(side, side), { right, up, toward } = stage;
  const [xr, yr, zr] = right, [xu, yu, zu] = up, [xt, yt, zt] = toward, [xl, yl, zl] = LAMP, paint = image.data;
  for (let row = 0, at = 0; row < side; row++) for (let column = 0; column < side; column++, at += 4) {
    const x = ((column + 0.5) / side * 2 - 1) * limb, y = (1 - (row + 0.5) / side * 2) * limb;
    // where the line of sight through (x, y) meets the ball first; beside the ball, its rim
    const length = Math.sqrt(x * x + y * y + far * far), middle = far * far / length, inside = middle * middle - (far * far - 1);
    const near = (middle - Math.sqrt(Math.max(0, inside))) / length, depth = far * (1 - near);
    const px = near * (x * xr + y * xu) + depth * xt, py = near * (x * yr + y * yu) + depth * yt, pz = near * (x * zr + y * zu) + depth * zt;
    const light = 0.84 + 0.16 * (px * xl + py * yl + pz * zl), part = density ? 2 * density.value(px, py, pz) : 0;
    const low = ramp[part < 1 ? 0 : 1], high = ramp[part < 1 ? 1 : 2], share = part < 1 ? part : part - 1;
    for (let c = 0; c < 3; c++) paint[at + c] = light * (low[c] + share * (high[c] - low[c]));
    paint[at + 3] = 255;
  }
  pen.putImageData(image, 0, 0);
  return canvas;
}
