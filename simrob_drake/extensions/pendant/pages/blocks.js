// The picture of blocks: zoomed by buttons, by + - 0 and by the wheel with Ctrl, moved by dragging; values stand on wires.
window.blocks = (() => {
  const box = (target) => target.closest(".block-picture");
  const zoom = (target, factor, { clientX, clientY } = {}) => { // 0 fits all of it
    const place = box(target);
    const svg = place.querySelector("svg");
    if (!svg) return;
    const { left, top, width, height } = svg.getBoundingClientRect();
    const [own, tall] = [+svg.getAttribute("width"), +svg.getAttribute("height")];
    const room = document.fullscreenElement ? innerHeight : 0.6 * innerHeight;
    const to = factor ? (factor * width) / own : Math.min(place.clientWidth / own, room / tall);
    const x = clientX ?? left + width / 2;
    const y = clientY ?? top + height / 2;
    const by = (Math.min(Math.max(to, 0.1), 6) * own) / width;
    place.style.setProperty("--zoom", (width / own) * by);
    place.classList.add("zoomed");
    place.scrollBy((x - left) * (by - 1), (y - top) * (by - 1));
  };
  const wheel = (event) => {
    if (!event.ctrlKey) return; // else the page scrolls
    event.preventDefault();
    zoom(event.target, Math.exp(-event.deltaY / 400), event);
  };
  // Arrow keys go to the nearest block on that side; one straight ahead is nearer than one to the side of the way.
  const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const middle = (element) => {
    const { left, top, width, height } = element.getBoundingClientRect();
    return [left + width / 2, top + height / 2];
  };
  const walk = (event) => {
    const here = event.target.closest("[data-block]");
    const way = ARROWS[event.key];
    if (!here || !way) return;
    event.preventDefault(); // else the page scrolls
    const [x, y] = middle(here);
    let nearest = null;
    let shortest = Infinity;
    for (const block of box(here).querySelectorAll("[data-block]")) {
      const [across, down] = middle(block).map((at, axis) => at - [x, y][axis]);
      const ahead = across * way[0] + down * way[1];
      const aside = Math.abs(across * way[1]) + Math.abs(down * way[0]);
      if (ahead > 1 && ahead + 2 * aside < shortest) [nearest, shortest] = [block, ahead + 2 * aside];
    }
    nearest?.focus();
  };
  const key = (event) => {
    walk(event);
    const factor = { "+": 1.25, "-": 0.8, 0: 0 }[event.key];
    if (factor !== undefined) zoom(event.target, factor);
  };
  const choose = (event, emit) => {
    const found = event.target.closest("[data-block], [data-wire]");
    if (!found || (event.type === "keydown" && event.key !== "Enter" && event.key !== " ")) return;
    event.preventDefault();
    emit(found.dataset.block ?? "", found.dataset.wire ?? "", event.type === "keydown");
  };
  const enlarge = ({ target }) => (document.fullscreenElement ? document.exitFullscreen() : box(target).requestFullscreen());
  const drag = (event) => {
    if (event.buttons !== 1 || event.target.closest("button")) return;
    box(event.target).scrollBy(-event.movementX, -event.movementY);
  };
  const reveal = () => { // scrolls the picture, and not the page, to what is chosen
    const chosen = document.querySelector(".block-picture .chosen");
    if (!chosen) return;
    const [own, place] = [chosen.getBoundingClientRect(), box(chosen).getBoundingClientRect()];
    const by = (low, high, from, to) => (low < from ? low - from : Math.max(Math.min(high - to, low - from), 0));
    box(chosen).scrollBy(by(own.left, own.right, place.left, place.right), by(own.top, own.bottom, place.top, place.bottom));
  };
  const back = (event) => { // from what is shown of a block to the block itself
    if (event.key === "Escape") document.querySelector(".block-picture [data-block].chosen")?.focus();
  };
  const values = (texts) => {
    for (const [wire, text] of Object.entries(texts)) {
      const place = document.querySelector(`.block-picture [data-value="${wire}"]`);
      if (place) place.textContent = text;
    }
  };
  return { zoom, wheel, key, choose, enlarge, drag, values, reveal, back };
})();
