// What makes Meshcat's page a window of a run: it does what the run tells, and tells of sliders and buttons.
(() => {
  const waiting = new Map();
  let busy = false;
  window.tell = async (...said) => {
    waiting.set(...said);
    if (busy) return;
    busy = true; // one after the other: the last word on each must arrive last
    for (const [name, value] of waiting) {
      waiting.delete(name);
      await fetch("told", { method: "POST", body: JSON.stringify([name, value]) }).catch(() => {});
    }
    busy = false;
  };

  const bytes = (text) => Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  const copy = ({ source, path, color, opacity }) => {
    const steps = (text) => text.split("/").filter(Boolean);
    const object = viewer.scene_tree.find(steps(source)).object.clone();
    object.position.set(0, 0, 0); // its path has the pose
    object.quaternion.identity();
    object.traverse((part) => {
      if (!part.isMesh) return;
      part.material = [part.material].flat()[0].clone();
      part.material.color.set(color);
      Object.assign(part.material, { opacity, transparent: true, depthWrite: false });
    });
    viewer.set_object(steps(path), object);
    viewer.set_dirty();
  };
  const bodies = new Set(); // by their paths
  const board = { bodies, held: false, heard: {} }; // for other scripts: whether something is held, and their commands
  window.board = board;
  let followed = null; // where the robot was that the camera goes with
  const follow = ({ place, begins }) => {
    if (board.held) return; // else a target would flee from what it pulls
    if (begins) followed = place; // the camera was put before it
    const [ahead, aside] = followed ? place.map((value, axis) => value - followed[axis]) : [0, 0];
    for (const moved of [viewer.camera.position, viewer.controls.target]) {
      moved.x += ahead; // the camera's axes are turned: its y is up
      moved.z -= aside;
    }
    followed = place;
    viewer.set_dirty();
  };
  const LOWEST = 0.02; // height of the camera above the floor [m]
  const has_floor = () => "floor" in (viewer.scene_tree.children.drake?.children.station?.children ?? {});
  const stay_above_floor = () => { // a floor hides everything from a camera below it
    const { camera, controls } = viewer;
    if (!has_floor()) {
      controls.maxPolarAngle = Math.PI;
      return;
    }
    const distance = camera.position.distanceTo(controls.target);
    const cosine = (LOWEST - controls.target.y) / distance;
    controls.maxPolarAngle = Math.acos(Math.min(Math.max(cosine, -1), 1));
    // Zooming out lowers a camera that looks up. The limit above acts only at the next update.
    if (camera.position.y < LOWEST - 1e-3) controls.update();
  };
  let limited = null; // the controls that keep the camera above the floor
  const limit_camera = () => { // Meshcat makes new controls with each camera
    if (limited === viewer.controls) return;
    limited = viewer.controls;
    limited.addEventListener("change", stay_above_floor);
  };
  const note = document.body.appendChild(document.createElement("div"));
  note.style = "position: absolute; top: 8px; left: 12px; font: 18px sans-serif; white-space: pre-line; pointer-events: none";
  const obey = (command) => {
    if (command.type === "set_transform" && !command.still) bodies.add(command.path);
    if (typeof command === "string") viewer.handle_command_bytearray(bytes(command));
    else if (command.type === "asset") casAssets[command.name] = command.url;
    else if (command.type === "copy") copy(command);
    else if (command.type === "follow") follow(command);
    else if (command.type === "said") note.textContent = command.text;
    else if (command.type in board.heard) board.heard[command.type](command);
    else viewer.handle_command(command);
    if (command.type === "set_control") viewer.gui.open();
    limit_camera();
  };
  window.shade = (dark) => { // as the page around is
    window.dark = dark;
    const [top, bottom] = dark ? [[0.11, 0.13, 0.16], [0.2, 0.23, 0.27]] : [[1, 1, 1], [0.86, 0.88, 0.91]];
    for (const [property, value] of Object.entries({ top_color: top, bottom_color: bottom }))
      viewer.handle_command({ type: "set_property", path: "/Background/<object>", property, value });
    viewer.scene_tree.children.drake?.children.station?.children.floor?.object.traverse((part) => {
      if (!part.isMesh) return;
      part.userData.light ??= part.material.color.clone();
      part.material.color.copy(part.userData.light).multiplyScalar(dark ? 0.12 : 1);
    });
    viewer.set_dirty();
  };
  let events = null;
  let seen = 0;
  const listen = () => { // a tab that is behind others leaves its connection to them: browsers have six for all tabs
    events?.close();
    events = document.hidden ? null : new EventSource(`events?after=${seen}`);
    if (!events) return;
    events.onmessage = ({ data, lastEventId }) => {
      seen = Number(lastEventId) || seen;
      const commands = JSON.parse(data);
      commands.forEach(obey);
      if (window.dark && commands.some((command) => typeof command === "string")) window.shade(true); // drawn anew
    };
    events.addEventListener("end", () => {
      events.close();
      document.removeEventListener("visibilitychange", listen);
      document.title = "ended";
    });
  };
  document.addEventListener("visibilitychange", listen);
  listen();
})();
