// The timeline of moves: a block is dragged to another place, or by its edge to take another time.
window.timeline = (() => {
  const drag = (event, emit) => {
    const block = event.target.closest("[data-move]");
    if (!block) return;
    if (event.type === "dragstart") event.dataTransfer.setData("simrob/move", block.dataset.move);
    else if (event.dataTransfer.types.includes("simrob/move")) event.preventDefault();
    const moved = event.type === "drop" && event.dataTransfer.getData("simrob/move");
    if (moved) emit(Number(moved), Number(block.dataset.move));
  };
  const stretch = (event, emit) => {
    const edge = event.target.closest("[data-long]");
    if (!edge) return;
    const block = edge.parentElement;
    const [from, wide, long] = [event.clientX, block.offsetWidth, Number(edge.dataset.long)];
    const now = ({ clientX }) => long * Math.max(1 + (clientX - from) / wide, 0);
    block.draggable = false;
    edge.setPointerCapture(event.pointerId);
    edge.onpointermove = (event) => {
      block.style.flexGrow = now(event);
      edge.dataset.now = `${now(event).toFixed(2)} s`;
    };
    edge.onpointerup = (event) => {
      edge.onpointermove = edge.onpointerup = null;
      delete edge.dataset.now;
      block.draggable = true;
      emit(Number(block.dataset.move), now(event));
    };
    edge.onclick = (event) => event.stopPropagation(); // nobody asked for where the move began
  };
  return { drag, stretch };
})();
