// What a recording adds to Meshcat's page: lines on the floor, a lamp straight above whose shadows tell what is over
// what, a view that goes along with a robot that walks, how the run ended, a clock, a bar to play by, a legend and
// switches. RUN is written before this:
//   name    of the station; message: how the run ended, stopped: whether before its time; begin and end: times [s]
//   legend  of colours: [colour, what has it]; axes: colours of the world's x, y and z
//   way     how far the robot has gone in each frame, [x, y, z] [m]; empty where nobody walks
//   rate    frames of the animation in a second
//   middle  of what is seen in the first frame, [x, y, z], and radius of a ball around that [m]
//   lines   on the floor, [begin, end] of [x, y, z] [m], and their spacing [m]; none without a floor
(() => {
  const { way, rate, middle, radius, lines, spacing, legend, axes, begin: start, end } = RUN;
  const length = end - start;  // [s]; the animation begins at 0
  const three = MeshCat.THREE;

  // In short parts: some browsers leave a line out whose one end is behind the eye.
  const parts = lines.flatMap(([begin, end]) => {
    const count = Math.ceil(Math.hypot(end[0] - begin[0], end[1] - begin[1]) / spacing);
    const at = (part) => begin.map((from, axis) => from + (part / count) * (end[axis] - from));
    return Array.from({ length: count }, (_, part) => [...at(part), ...at(part + 1)]).flat();
  });
  const grid = new three.BufferGeometry();
  grid.setAttribute("position", new three.Float32BufferAttribute(parts, 3));
  const pen = new three.LineBasicMaterial({ color: 0xa9b0ba });
  viewer.set_object(["drake", "floor_lines"], new three.LineSegments(grid, pen));

  const lamp = new three.DirectionalLight(0xffffff, 1.5);
  const { shadow } = lamp;
  Object.assign(shadow, { bias: -0.002, normalBias: 0.006 * radius, radius: 3 });
  Object.assign(shadow.camera, { left: -radius, right: radius, bottom: -radius, top: radius });
  Object.assign(shadow.camera, { near: radius, far: 5 * radius });
  shadow.mapSize.set(2048, 2048);
  lamp.castShadow = true;
  viewer.scene.add(lamp, lamp.target);
  for (const name of ["PointLightNegativeX", "PointLightPositiveX"])
    viewer.set_property(["Lights", name, "<object>"], "intensity", 14);

  const add = (where, kind, what, ...parts) => {
    const element = Object.assign(document.createElement(kind), what);
    element.append(...parts);
    where.append(element);
    return element;
  };
  const style = `
    #run, #player { position: fixed; left: 12px; font: 13px sans-serif; color: #333; }
    #run { top: 10px; max-width: 60%; } #run b { display: block; font-size: 15px; } #run .stopped { color: #b2182b; }
    #player { right: 12px; bottom: 8px; padding: 6px 10px; border-radius: 6px; background: #fffd; }
    #player > div { display: flex; flex-wrap: wrap; align-items: center; gap: 4px 1em; }
    #player input[type=range] { flex: 1; accent-color: #555; } #player button { width: 2.6em; height: 1.9em; }
    #clock { min-width: 8.5em; text-align: right; font-variant-numeric: tabular-nums; }
    #player i { display: inline-block; width: 1.2em; height: 4px; margin-right: 4px; vertical-align: middle; }`;
  add(document.head, "style", {}, style);
  document.title = RUN.name;
  const words = add(document.body, "div", { id: "run" });
  add(words, "b", {}, RUN.name);
  add(words, "span", { className: RUN.stopped ? "stopped" : "" }, RUN.message);

  const { animator } = viewer;
  const panel = add(document.body, "div", { id: "player" });
  const bar = add(panel, "div", {});
  const button = add(bar, "button", { type: "button", onclick: () => play(!animator.playing) });
  button.innerHTML = '<svg width="12" height="12"><path/></svg>';
  const sign = button.querySelector("path");
  const slider = add(bar, "input", { type: "range", min: 0, max: length, step: 0.001, ariaLabel: "time" });
  const clock = add(bar, "span", { id: "clock" });
  const paces = add(bar, "select", { ariaLabel: "pace" });
  for (const pace of [0.1, 0.25, 0.5, 1, 2, 4]) add(paces, "option", { value: pace, selected: pace === 1 }, `× ${pace}`);
  paces.onchange = () => (animator.mixer.timeScale = Number(paces.value));
  const play = (on) => (on ? animator.play() : animator.pause());
  slider.oninput = () => {
    play(false);
    animator.seek(Number(slider.value));
    animator.display_progress(Number(slider.value));
    tell();
  };
  document.addEventListener("keydown", (event) => {
    if (event.code !== "Space" || event.target !== document.body) return;
    event.preventDefault();
    play(!animator.playing);
  });
  const tell = () => {
    const time = Math.min(animator.time, length);
    if (document.activeElement !== slider || animator.playing) slider.value = time;
    clock.textContent = `${(start + time).toFixed(2)} / ${end.toFixed(2)} s`;
    sign.setAttribute("d", animator.playing ? "M2 1h3v10H2zM7 1h3v10H7z" : "M2 1l9 5l-9 5z");
    button.ariaLabel = animator.playing ? "pause" : "play";
  };

  const swatches = add(panel, "div", { id: "legend" });
  const add_colour = (where, colour, ...text) => add(where, "span", {}, add(where, "i", { style: `background: ${colour}` }), ...text);
  for (const [colour, text] of legend) add_colour(swatches, colour, text);
  if (lines.length) add(swatches, "span", {}, `lines on the floor every ${spacing} m`);
  const switches = add(panel, "div", { id: "switches" });
  const add_switch = (text, checked, act) => {
    const label = add(switches, "label", {});
    const onchange = ({ target }) => (act(target.checked), viewer.set_dirty());
    const box = add(label, "input", { type: "checkbox", checked, onchange });
    label.append(text);
    return box;
  };
  const follow = way.length ? add_switch("follow the robot", true, () => {}) : null;
  add_switch("the world's axes, 0.5 m", true, (on) => viewer.set_property(["Axes"], "visible", on));
  axes.forEach((colour, axis) => add_colour(switches, colour, "xyz"[axis]));

  // Nothing of the picture hides behind the panel.
  document.getElementById("meshcat-pane").style.height = `calc(100vh - ${panel.offsetHeight + 16}px)`;
  viewer.set_3d_pane_size();

  // The world goes by: a camera that moved would go on looking at where it began.
  const gone = (time) => {
    const frame = Math.min(time * rate, way.length - 1);
    const [low, high] = [way[Math.floor(frame)], way[Math.ceil(frame)]];
    return low ? low.map((from, axis) => from + (frame % 1) * (high[axis] - from)) : [0, 0, 0];
  };
  let seen = [0, 0, 0];
  const update = animator.update.bind(animator);
  animator.update = () => {
    // A part whose motion ends before the others' would begin again before them.
    for (const action of animator.actions) action.getClip().duration = animator.duration;
    update();
    tell();
    const now = gone(animator.time);
    if (follow?.checked) seen = now;
    for (const name of ["drake", "Axes"]) viewer.scene_tree.find([name]).object.position.set(...seen.map((part) => -part));
    const [x, y, z] = middle.map((from, axis) => from + now[axis] - seen[axis]);
    lamp.position.set(x, y, z + 3 * radius);
    lamp.target.position.set(x, y, z);
  };
})();
