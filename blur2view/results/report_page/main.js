// The page: which photograph the address names, downloads, and the mark "blur2view-ready" for measuring.

function download(name, parts, type) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob(parts, { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** The photograph's name without folders and suffix. */
function stemOf(name) {
  return name.split(/[\\/]/).pop().replace(/\.[^.]*$/, "") || "photograph";
}

function textOf(index) {
  return JSON.parse(byId(`photo-data-${index}`).textContent).document;
}

/** The document of `blur2view estimate --json` for all photographs. */
function wholeDocument(indices) {
  const deeper = (text) => `    ${text.replaceAll("\n", "\n    ")}`;
  const list = (texts) => (texts.length ? `[\n${texts.map(deeper).join(",\n")}\n  ]` : "[]");
  const failures = JSON.parse(byId("failures").textContent).map((failure) => JSON.stringify(failure, null, 2));
  const estimates = indices.map(textOf);
  return `{\n  "estimates": ${list(estimates)},\n  "failures": ${list(failures)}\n}\n`;
}

/** The stage as it is seen, with the marks, as a PNG. */
async function savePicture(viewer) {
  const { canvas, marks, view, photo } = viewer;
  const copy = document.createElement("canvas");
  [copy.width, copy.height] = [canvas.width, canvas.height];
  const drawing = marks.cloneNode(true);
  drawing.setAttribute("xmlns", SVG);
  drawing.setAttribute("viewBox", `0 0 ${view.width} ${view.height}`);
  drawing.setAttribute("width", canvas.width);
  drawing.setAttribute("height", canvas.height);
  const markup = new XMLSerializer().serializeToString(drawing);
  const image = await imageOf(`data:image/svg+xml,${encodeURIComponent(markup)}`);
  const context = copy.getContext("2d");
  context.drawImage(canvas, 0, 0);
  context.drawImage(image, 0, 0);
  copy.toBlob((blob) => download(`${stemOf(photo.name)}.view.png`, [blob], "image/png"));
}

class Page {
  constructor() {
    this.gallery = new Gallery();
    this.viewer = new Viewer();
    this.opened = null;
    window.addEventListener("hashchange", () => this.follow());
    byId("download").addEventListener("click", () => {
      download(`${stemOf(this.viewer.photo.name)}.json`, [this.viewer.photo.text, "\n"], "application/json");
    });
    byId("save-picture").addEventListener("click", () => savePicture(this.viewer));
    byId("download-all").addEventListener("click", () => {
      const indices = [...this.gallery.order].sort((one, other) => one - other);
      download("estimates.json", [wholeDocument(indices)], "application/json");
    });
    byId("download-all").hidden = false;
  }

  /** The photograph that the address names; the only one if there is but one; else null. */
  get wanted() {
    const { order, cards } = this.gallery;
    const named = Number((/^#photo-(\d+)$/.exec(location.hash) || [])[1]);
    if (order.includes(named)) return named;
    return cards.length === 1 && order.length === 1 ? order[0] : null;
  }

  /** Show what the address names, or say that it cannot be shown. */
  follow() {
    this.route().catch((error) => {
      tell(`The page is damaged: ${error.message}. Make it again with blur2view report.`);
      throw error;
    });
  }

  async route() {
    const { wanted } = this;
    const [before, first] = [this.opened, !this.ready];
    this.opened = wanted;
    if (wanted !== null) await this.open(wanted, !first);
    if (this.opened !== wanted) return; // another one was asked for meanwhile
    byId("gallery").hidden = wanted !== null;
    if (wanted === null) {
      byId("photo").hidden = true;
      if (before !== null) this.gallery.focus(before);
    }
    if (first) this.markReady();
  }

  async open(index, focus) {
    const photo = await photographOf(index);
    if (this.opened !== index) return;
    byId("gallery").hidden = true;
    byId("photo").hidden = false;
    this.gallery.link(index);
    this.viewer.show(photo);
    if (!focus) return;
    window.scrollTo(0, 0);
    byId("photo-title").focus({ preventScroll: true });
  }

  markReady() {
    this.ready = true;
    requestAnimationFrame(() => setTimeout(() => performance.mark("blur2view-ready"))); // after it was painted
  }
}

function tell(message) {
  byId("notice").textContent = message;
  byId("notice").hidden = false;
}

if (typeof DecompressionStream === "undefined") {
  tell("This browser is too old to show the pictures: it needs to be of 2023 or later.");
} else {
  new Page().follow();
}
