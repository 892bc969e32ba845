// Lays out each page in frames of several widths and media, and lists what is wrong.
// PAGES: [{name, html}]; VIEWS: [{width, media}], media light, dark or print.
"use strict";

// Tolerances in pixels: rounding of boxes, and content areas of fonts that are higher than their line.
const ROUNDING = 1.5, LINE = 4;
// Smallest contrast of text: WCAG 2.2, level AA.
const CONTRAST = 4.5;

function applyMedia(doc, media) {
  for (const sheet of doc.styleSheets) for (const rule of sheet.cssRules) {
    if (!rule.media) continue;
    const text = rule.media.mediaText;
    if (text.includes("dark")) rule.media.mediaText = media === "dark" ? "all" : "not all";
    if (text === "print") rule.media.mediaText = media === "print" ? "all" : "not all";
  }
}

function texts(doc) {
  const walker = doc.createTreeWalker(doc.body, NodeFilter.SHOW_TEXT), found = [];
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    if (!node.data.trim() || node.parentElement.closest("script, style")) continue;
    const range = doc.createRange();
    range.selectNodeContents(node);
    for (const box of range.getClientRects())
      if (box.width > 0 && box.height > 0) found.push({ node, box, text: node.data.trim().slice(0, 40) });
  }
  return found;
}

function colour(text) {
  const [r, g, b, a = 1] = text.match(/[\d.]+/g).map(Number);
  return { rgb: [r, g, b], a };
}

function luminance(rgb) {
  const [r, g, b] = rgb.map(v => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

function contrast(view, element) {
  const style = view.getComputedStyle(element);
  const ink = luminance(colour(element.closest("svg") ? style.fill : style.color).rgb);
  let at = element;
  while (at && colour(view.getComputedStyle(at).backgroundColor).a < 1) at = at.parentElement;
  const paper = luminance(at ? colour(view.getComputedStyle(at).backgroundColor).rgb : [255, 255, 255]);
  return (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05);
}

function problems(frame, media) {
  const doc = frame.contentDocument, view = frame.contentWindow, found = [];
  applyMedia(doc, media);
  const root = doc.documentElement, width = root.clientWidth;
  if (root.scrollWidth > width) found.push(`the page is ${root.scrollWidth} pixels wide`);
  for (const element of doc.body.querySelectorAll("*")) {
    if (element.closest("svg") || view.getComputedStyle(element).display === "inline") continue;
    if (element.clientWidth > 0 && element.scrollWidth > element.clientWidth + ROUNDING)
      found.push(`<${element.localName} class="${element.className}"> is too narrow for its content: ${element.textContent.trim().slice(0, 40)}`);
  }
  const all = texts(doc);
  for (const { node, box, text } of all) {
    let around = node.parentElement.closest("svg");
    if (!around) for (around = node.parentElement; view.getComputedStyle(around).display === "inline";) around = around.parentElement;
    const outer = around.getBoundingClientRect();
    const out = box.left < outer.left - ROUNDING || box.right > outer.right + ROUNDING
      || box.top < outer.top - LINE || box.bottom > outer.bottom + LINE;
    if (out) found.push(`outside of <${around.localName} class="${around.getAttribute("class") || ""}">: ${text}`);
    if (box.left < -ROUNDING || box.right > width + ROUNDING) found.push(`outside of the window: ${text}`);
    if (contrast(view, node.parentElement) < CONTRAST) found.push(`too little contrast: ${text}`);
  }
  all.sort((a, b) => a.box.top - b.box.top);
  all.forEach((a, i) => {
    for (let k = i + 1; k < all.length && all[k].box.top < a.box.bottom - LINE; k++) {
      const b = all[k];
      const wide = Math.min(a.box.right, b.box.right) - Math.max(a.box.left, b.box.left);
      const high = Math.min(a.box.bottom, b.box.bottom) - b.box.top;
      if (a.node !== b.node && wide > ROUNDING && high > LINE) found.push(`overlap: ${a.text} | ${b.text}`);
    }
  });
  if (media === "print" && luminance(colour(view.getComputedStyle(doc.body).backgroundColor).rgb) < 0.9)
    found.push("printed on a dark page");
  if (all.length < 10) found.push("hardly any text");
  return found;
}

async function main() {
  const report = [];
  for (const { name, html } of PAGES) for (const { width, media } of VIEWS) {
    const frame = document.createElement("iframe");
    frame.style = `width:${width}px; height:900px; border:0`;
    const loaded = new Promise(done => frame.onload = done);
    frame.srcdoc = html;
    document.body.append(frame);
    await loaded;
    for (const problem of new Set(problems(frame, media))) report.push(`${name}, ${width} pixels, ${media}: ${problem}`);
    frame.remove();
  }
  const out = document.createElement("pre");
  out.id = "report";
  out.textContent = `checked ${PAGES.length * VIEWS.length}\n` + report.join("\n");
  document.body.append(out);
}

main();
