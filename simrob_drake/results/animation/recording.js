// What a recording adds to Meshcat's page: lines on the floor, a lamp straight above whose shadows tell what is over
// what, a view that goes along with a robot that walks, and switches. RUN is written before this:
//   way     how far the robot has gone in each frame, [x, y, z] [m]; empty where nobody walks
//   rate    frames of the animation in a second
//   middle  of what is seen in the first frame, [x, y, z], and radius of a ball around that [m]
//   lines   on the floor, [begin, end] of [x, y, z] [m], and their spacing [m]; none without a floor
//   touches  whether contact forces are computed
(() => {
  const { way, rate, middle, radius, lines, spacing, touches } = RUN;
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

  const bar = document.createElement("div");
  bar.id = "switches";
  bar.style = "position: fixed; left: 12px; bottom: 10px; font: 13px sans-serif; color: #333";
  document.body.append(bar);
  const add_switch = (text, checked, act) => {
    const label = document.createElement("label");
    const box = document.createElement("input");
    Object.assign(box, { type: "checkbox", checked, onchange: () => (act(box.checked), viewer.set_dirty()) });
    label.style.marginRight = "1em";
    label.append(box, text);
    bar.append(label);
    return box;
  };
  const follow = way.length ? add_switch("follow the robot", true, () => {}) : null;
  const axes = "the world's axes, 0.5 m of x (red), y (green), z (blue)";
  add_switch(axes, true, (on) => viewer.set_property(["Axes"], "visible", on));
  if (lines.length) bar.append(`lines on the floor every ${spacing} m; `);
  if (touches) bar.append("arrows: contact forces (green), and their sum on a body (blue)");

  // The world goes by: a camera that moved would go on looking at where it began.
  const gone = (time) => {
    const frame = Math.min(time * rate, way.length - 1);
    const [low, high] = [way[Math.floor(frame)], way[Math.ceil(frame)]];
    return low ? low.map((from, axis) => from + (frame % 1) * (high[axis] - from)) : [0, 0, 0];
  };
  let seen = [0, 0, 0];
  const update = viewer.animator.update.bind(viewer.animator);
  viewer.animator.update = () => {
    // A part whose motion ends before the others' would begin again before them.
    for (const action of viewer.animator.actions) action.getClip().duration = viewer.animator.duration;
    update();
    const now = gone(viewer.animator.time);
    if (follow?.checked) seen = now;
    for (const name of ["drake", "Axes"]) viewer.scene_tree.find([name]).object.position.set(...seen.map((part) => -part));
    const [x, y, z] = middle.map((from, axis) => from + now[axis] - seen[axis]);
    lamp.position.set(x, y, z + 3 * radius);
    lamp.target.position.set(x, y, z);
  };
})();
