// The index of photographs: sorting its cards, showing those of one verdict, and stepping through them.

class Gallery {
  constructor() {
    this.list = byId("cards");
    this.by = byId("sort-by");
    this.reverse = byId("sort-direction");
    this.cards = [...this.list.children];
    this.kind = byId("show-kind");
    byId("sorting").hidden = this.cards.length < 2;
    for (const option of [...this.kind.options]) {
      if (option.value && !this.cards.some(({ dataset }) => dataset.kind === option.value)) option.remove();
    }
    this.kind.addEventListener("change", () => this.filter());
    this.by.addEventListener("change", () => this.sort());
    this.reverse.addEventListener("click", () => {
      this.reverse.setAttribute("aria-pressed", String(!this.reversed));
      this.sort();
    });
  }

  get reversed() {
    return this.reverse.getAttribute("aria-pressed") === "true";
  }

  /** Sort the cards; those without a value come last in either direction, equals keep the call's order. */
  sort() {
    const key = this.by.value;
    const named = key === "name";
    const valueOf = ({ dataset }) => (named ? dataset.name : dataset[key] === "" ? null : Number(dataset[key]));
    const compare = (one, other) => (named ? one.localeCompare(other, undefined, { numeric: true }) : one - other);
    const sign = this.reversed ? -1 : 1;
    this.cards.sort((one, other) => {
      const [a, b] = [valueOf(one), valueOf(other)];
      const absent = (a === null) - (b === null);
      return absent || (a === null ? 0 : sign * compare(a, b)) || one.dataset.index - other.dataset.index;
    });
    this.list.replaceChildren(...this.cards);
  }

  /** Hide the cards of other verdicts. */
  filter() {
    for (const card of this.cards) card.hidden = Boolean(this.kind.value) && card.dataset.kind !== this.kind.value;
  }

  /** Numbers of the photographs that can be opened, in the order of their cards. */
  get order() {
    return this.cards.filter((card) => card.querySelector("a")).map((card) => Number(card.dataset.index));
  }

  /** The same, without those that are hidden. */
  get shown() {
    const hidden = this.cards.filter((card) => card.hidden).map((card) => Number(card.dataset.index));
    return this.order.filter((index) => !hidden.includes(index));
  }

  /** Point the links of a photograph to its neighbours. */
  link(index) {
    const { shown } = this;
    const place = shown.indexOf(index);
    const beside = (step) => (place < 0 ? undefined : shown[place + step]);
    const targets = [["to-previous", beside(-1)], ["to-next", beside(1)]];
    for (const [id, target] of targets) {
      byId(id).classList.toggle("gone", target === undefined);
      byId(id).href = `#photo-${target}`;
    }
    byId("steps").hidden = this.cards.length < 2;
  }

  focus(index) {
    const card = this.cards.find((each) => Number(each.dataset.index) === index);
    const link = card && card.querySelector("a");
    if (link) link.focus();
  }
}
