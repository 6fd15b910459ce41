// The index of photographs: sorting its cards, and stepping through them in that order.

class Gallery {
  constructor() {
    this.list = byId("cards");
    this.by = byId("sort-by");
    this.reverse = byId("sort-direction");
    this.cards = [...this.list.children];
    byId("sorting").hidden = this.cards.length < 2;
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

  /** Numbers of the photographs that can be opened, in the order shown. */
  get order() {
    return this.cards.filter((card) => card.querySelector("a")).map((card) => Number(card.dataset.index));
  }

  /** Point the links of a photograph to its neighbours. */
  link(index) {
    const { order } = this;
    const place = order.indexOf(index);
    const targets = [["to-previous", order[place - 1]], ["to-next", order[place + 1]]];
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
