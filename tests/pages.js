// Body of a function that returns what is wrong with the page at the size and in the colours it has now.
const MIN_LETTER_PX = 9;
const found = [];

const folded = [...document.querySelectorAll("details:not([open])")];
for (const details of folded) details.open = true;

function place(element) {
  const classes = element.getAttribute("class");
  return element.localName + (element.id ? "#" + element.id : classes ? "." + classes.trim().split(/\s+/).join(".") : "");
}

function isShown(element) {
  return element.checkVisibility({ opacityProperty: true, visibilityProperty: true });
}

// Colours: a canvas reads any notation of CSS.
const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
canvas.canvas.width = canvas.canvas.height = 1;
const known = new Map();
function rgba(color) {
  if (!known.has(color)) {
    canvas.clearRect(0, 0, 1, 1);
    canvas.fillStyle = color;
    canvas.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = canvas.getImageData(0, 0, 1, 1).data;
    known.set(color, [r, g, b, a / 255]);
  }
  return known.get(color);
}
const mix = (below, above, share) => below.map((value, i) => value + share * (above[i] - value));
const over = (below, color) => mix(below, color, color[3]);

// What lies under the text and what the text looks like, from the root to the element; an opacity holds for both.
function painted(chain, below, letters) {
  const style = getComputedStyle(chain[0]);
  const ground = over(below, rgba(style.backgroundColor));
  const both = chain.length > 1 ? painted(chain.slice(1), ground, letters) : [ground, over(ground, letters)];
  return both.map((color) => mix(below, color, Number(style.opacity)));
}

function luminance(color) {
  const [r, g, b] = color.map((value) => {
    const x = value / 255;
    return x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4;
  });
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

function contrast(element, letters) {
  const chain = [];
  for (let each = element; each; each = each.parentElement) chain.unshift(each);
  // The page's own ground where nothing is painted: CSS calls it Canvas.
  const scheme = getComputedStyle(document.documentElement).colorScheme;
  const isDark = scheme.includes("dark") && matchMedia("(prefers-color-scheme: dark)").matches;
  const both = painted(chain, isDark ? [18, 18, 18] : [255, 255, 255], letters).map(luminance);
  return (Math.max(...both) + 0.05) / (Math.min(...both) + 0.05);
}

function checkText(element, text) {
  const style = getComputedStyle(element);
  const isDrawn = element instanceof SVGElement;
  const scale = isDrawn ? Math.abs(element.getScreenCTM().a) : 1;
  const size = parseFloat(style.fontSize) * scale;
  const name = `'${text.trim().slice(0, 40)}' in ${place(element)}`;
  if (size < MIN_LETTER_PX) found.push(`letters of ${size.toFixed(1)} px: ${name}`);
  const isLarge = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
  const ratio = contrast(element, rgba(isDrawn ? style.fill : style.color));
  if (ratio < (isLarge ? 3 : 4.5)) found.push(`contrast ${ratio.toFixed(2)}: ${name}`);
  if (isDrawn) {
    const letters = element.getBoundingClientRect(), drawing = element.ownerSVGElement.getBoundingClientRect();
    const isInside = ["left", "top"].every((side) => letters[side] >= drawing[side] - 1)
      && ["right", "bottom"].every((side) => letters[side] <= drawing[side] + 1);
    if (!isInside) found.push(`cut: ${name}`);
  }
}

const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
while (texts.nextNode()) {
  const parent = texts.currentNode.parentElement;
  if (!texts.currentNode.data.trim() || parent.matches("script, style, option, title, desc") || !isShown(parent)) continue;
  if (parent.closest(":disabled")) continue;
  const range = document.createRange();
  range.selectNodeContents(texts.currentNode);
  if (range.getBoundingClientRect().width > 1) checkText(parent, texts.currentNode.data);
}
for (const control of document.querySelectorAll("select, textarea, input:not([type=range], [type=checkbox], [type=radio], [type=hidden])"))
  if (isShown(control) && !control.disabled) checkText(control, control.value || control.localName);

// Widths: what does not fit must scroll in its own box.
const width = document.documentElement.clientWidth;
if (document.documentElement.scrollWidth > width) found.push(`the page is ${document.documentElement.scrollWidth} px wide on ${width}`);
for (const element of document.body.querySelectorAll("*")) {
  if (!isShown(element) || element instanceof SVGElement || element.clientWidth <= 1 || element.matches("input, select")) continue;
  const scrolls = ["auto", "scroll"].includes(getComputedStyle(element).overflowX);
  if (!scrolls && element.scrollWidth > element.clientWidth + 1)
    found.push(`${element.scrollWidth} px in ${element.clientWidth}: ${place(element)}`);
}

// Names, for those who do not see the page.
for (const element of document.querySelectorAll("input:not([type=hidden]), select, textarea, canvas, img, svg, button, a[href]")) {
  if (!element.checkVisibility({ visibilityProperty: true }) || element.closest("[aria-hidden=true]") || element.ownerSVGElement) continue;
  const labels = [...(element.labels ?? [])].map((label) => label.textContent);
  const others = (element.getAttribute("aria-labelledby") ?? "").split(/\s+/).map((id) => document.getElementById(id)?.textContent);
  const own = element.matches("canvas, button, a") ? element.textContent : element.querySelector?.(":scope > title")?.textContent;
  const names = [element.getAttribute("aria-label"), element.getAttribute("alt"), element.title, own, ...labels, ...others];
  if (!names.some((name) => typeof name === "string" && name.trim())) found.push(`no name: ${place(element)}`);
}

const ids = [...document.querySelectorAll("[id]")].map((element) => element.id);
for (const id of new Set(ids.filter((each, index) => ids.indexOf(each) !== index))) found.push(`found twice: #${id}`);
for (const entry of performance.getEntriesByType("resource"))
  if (!/^(data|blob):/.test(entry.name) && !entry.name.startsWith(`${location.origin}/`)) found.push(`from elsewhere: ${entry.name}`);

for (const details of folded) details.open = false;
return found;
