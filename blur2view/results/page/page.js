"use strict";
// Layers: a checkbox gives the picture a class of its name, which the style sheet shows.
for (const article of document.querySelectorAll("article")) {
  const svg = article.querySelector("svg");
  for (const box of article.querySelectorAll("input")) {
    const show = () => svg.classList.toggle(box.name, box.checked);
    box.parentNode.hidden = !svg.querySelector(box.name === "smears" ? ".smear" : box.name === "lines" ? ".line"
      : "image." + box.name);
    box.addEventListener("change", show);
    show();
  }
  zoomable(svg, article.querySelector("button"));
}

// Ctrl and wheel zooms about the pointer, a drag moves the picture, the button shows all of it again.
function zoomable(svg, button) {
  const whole = svg.getAttribute("viewBox");
  const box = svg.viewBox.baseVal;
  const show = (view) => { svg.setAttribute("viewBox", view); button.hidden = view === whole; };
  const set = (x, y, width, height) => show([x, y, width, height].join(" "));
  const at = (event) => new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
  svg.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return;
    event.preventDefault();
    const { x, y } = at(event), by = Math.exp(event.deltaY / 300);
    set(x - (x - box.x) * by, y - (y - box.y) * by, box.width * by, box.height * by);
  }, { passive: false });
  let from = null;
  svg.addEventListener("pointerdown", (event) => { from = at(event); svg.setPointerCapture(event.pointerId); });
  svg.addEventListener("pointerup", () => { from = null; });
  svg.addEventListener("pointermove", (event) => {
    if (from === null) return;
    const to = at(event);
    set(box.x + from.x - to.x, box.y + from.y - to.y, box.width, box.height);
  });
  button.addEventListener("click", () => show(whole));
}

// A click on a head sorts the index by that column, a second one the other way round.
const body = document.querySelector("#index tbody");
document.querySelectorAll("#index th").forEach((head, column) => head.addEventListener("click", () => {
  const up = head.ariaSort !== "ascending";
  for (const other of head.parentNode.children) other.ariaSort = null;
  head.ariaSort = up ? "ascending" : "descending";
  const value = (row) => row.children[column].textContent.trim();
  const rows = [...body.rows].sort((a, b) => value(a).localeCompare(value(b), undefined, { numeric: true }));
  body.append(...(up ? rows : rows.reverse()));
}));
