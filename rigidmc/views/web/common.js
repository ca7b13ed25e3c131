// ---- elements, data, speeds and themes, on every page ----------------------------------------

const $ = id => document.getElementById(id);
function html(tag, attributes, text) {   // names may come from other people's files: text, never code
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  if (text !== undefined) made.textContent = text;
  return made;
}
const DATA = JSON.parse($("data").textContent);
const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0));
const clamp = (x, low, high) => Math.min(high, Math.max(low, x));
const degrees = x => x * 180 / Math.PI;
const colour = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const isDark = () => document.documentElement.classList.contains("dark");

// list speeds around the wanted one; return the nearest, which is selected
function listSpeeds(wanted) {
  const list = [];
  for (let p = -6; p <= 6; p++) for (const s of [1, 2, 5]) list.push(+(s * 10 ** p).toPrecision(1));
  const near = list.reduce((a, b) => Math.abs(Math.log(b / wanted)) < Math.abs(Math.log(a / wanted)) ? b : a);
  const at = list.indexOf(near);
  $("speed").replaceChildren(...list.slice(Math.max(0, at - 6), at + 8).map(s => html("option", { value: s }, `× ${nice(s)}`)));
  $("speed").value = near;
  return near;
}
function listOptions(id, words) {
  $(id).replaceChildren(...words.map(([value, word]) => html("option", { value }, word)));
}

// the theme: the system's, until the button or `d` changes it
function followTheme(draw) {
  const dress = dark => { document.documentElement.classList.toggle("dark", dark); draw(); };
  const scheme = matchMedia("(prefers-color-scheme: dark)");
  scheme.addEventListener("change", () => dress(scheme.matches));
  $("dark").onclick = () => dress(!isDark());
  document.documentElement.classList.toggle("dark", scheme.matches);
}
// keys: { key: action }; typing in a list is left alone, and what `isNative` of an event says
function onKeys(keys, isNative = () => false) {
  document.addEventListener("keydown", event => {
    if (event.target.tagName === "SELECT" || isNative(event) || event.ctrlKey || event.metaKey || event.altKey || !(event.key in keys)) return;
    event.preventDefault();
    keys[event.key]();
  });
  addEventListener("message", ({ source, data }) => { if (source === parent && source !== window) keys[data.key]?.(data); });
}
// draw when the window changes; a page in a frame tells the page around it how high it is
function onResize(draw) {
  if (parent !== window) new ResizeObserver(() => parent.postMessage({ pageHeight: document.documentElement.offsetHeight + 4 }, "*")).observe(document.body);
  let waiting;
  addEventListener("resize", () => { clearTimeout(waiting); waiting = setTimeout(draw, 100); });
}
