// What makes Meshcat's page a window of a run: it does what the run tells, and tells of sliders, buttons and drags.
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
  let held = null; // what is dragged: {body, name, point, plane}
  let followed = null; // where the robot was that the camera goes with
  const follow = ({ place, begins }) => {
    if (held) return; // else a target would flee from what it pulls
    if (begins) followed = place; // the camera was put before it
    const [ahead, aside] = followed ? place.map((value, axis) => value - followed[axis]) : [0, 0];
    for (const moved of [viewer.camera.position, viewer.controls.target]) {
      moved.x += ahead; // the camera's axes are turned: its y is up
      moved.z -= aside;
    }
    followed = place;
    viewer.set_dirty();
  };
  const note = document.body.appendChild(document.createElement("div"));
  note.style = "position: absolute; top: 8px; left: 12px; font: 18px sans-serif; white-space: pre-line; pointer-events: none";
  const bodies = new Set(); // by their paths
  const obey = (command) => {
    if (command.type === "set_transform" && !command.still) bodies.add(command.path);
    if (typeof command === "string") viewer.handle_command_bytearray(bytes(command));
    else if (command.type === "asset") casAssets[command.name] = command.url;
    else if (command.type === "copy") copy(command);
    else if (command.type === "follow") follow(command);
    else if (command.type === "said") note.textContent = command.text;
    else viewer.handle_command(command);
    if (command.type === "set_control") viewer.gui.open();
  };
  window.shade = (dark) => { // as the page around is
    window.dark = dark;
    const [top, bottom] = dark ? [[0.11, 0.13, 0.16], [0.2, 0.23, 0.27]] : [[1, 1, 1], [0.86, 0.88, 0.91]];
    for (const [property, value] of Object.entries({ top_color: top, bottom_color: bottom }))
      viewer.handle_command({ type: "set_property", path: "/Background", property, value });
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
  if (!drags) return;
  viewer.gui.domElement.style.display = "none"; // the page around has what there is to set

  // A body is dragged with Shift, or with the page around in the mood for it (window.dragging).
  const { Vector2, Vector3, Plane, Raycaster, Line, BufferGeometry, LineBasicMaterial } = MeshCat.THREE;
  const canvas = viewer.renderer.domElement;
  const ray = new Raycaster();
  const line = new Line(new BufferGeometry(), new LineBasicMaterial({ color: 0xd0208a, depthTest: false, transparent: true }));
  line.frustumCulled = false;
  line.renderOrder = 1; // over all else

  const aim = ({ clientX, clientY }) => {
    const { left, top, width, height } = canvas.getBoundingClientRect();
    const place = new Vector2((2 * (clientX - left)) / width - 1, 1 - (2 * (clientY - top)) / height);
    ray.setFromCamera(place, viewer.camera);
  };
  const path = (object) => (object.parent ? `${path(object.parent)}/${object.name}` : ""); // from the scene down
  const picked = () => {
    const meshes = [];
    viewer.scene_tree.find(["drake"]).object.traverseVisible((object) => object.isMesh && meshes.push(object));
    const [hit] = ray.intersectObjects(meshes, false);
    for (let body = hit?.object; body; body = body.parent) {
      const name = path(body);
      if (bodies.has(name)) return { body, name, at: hit.point, point: body.worldToLocal(hit.point.clone()) };
    }
    return null;
  };
  const said = (target) => [held.name, held.point.toArray(), target && target.toArray()];
  const report = (target) => window.tell("drag", said(target));
  const end = () => {
    if (!held) return;
    report(null);
    held = null;
    viewer.scene.remove(line);
    viewer.set_dirty();
  };
  const move = (event) => {
    if (!held) return;
    aim(event);
    const target = ray.ray.intersectPlane(held.plane, new Vector3());
    if (!target) return;
    const local = viewer.scene.worldToLocal(target); // the scene's axes are Drake's
    const grip = viewer.scene.worldToLocal(held.body.localToWorld(held.point.clone()));
    line.geometry.setFromPoints([grip, local]);
    viewer.set_dirty();
    report(local);
  };
  const start = (event) => {
    if (event.button !== 0 || !(event.shiftKey || window.dragging)) return;
    aim(event);
    const hit = picked();
    if (!hit) return;
    event.stopImmediatePropagation();
    event.preventDefault();
    const ahead = viewer.camera.getWorldDirection(new Vector3());
    held = { ...hit, plane: new Plane().setFromNormalAndCoplanarPoint(ahead, hit.at) };
    canvas.setPointerCapture(event.pointerId);
    viewer.scene.add(line);
    move(event);
  };
  canvas.addEventListener("pointerdown", start, true);
  canvas.addEventListener("pointermove", move, true);
  ["pointerup", "pointercancel", "lostpointercapture"].forEach((name) => canvas.addEventListener(name, end, true));
  window.addEventListener("blur", end);
  window.addEventListener("pagehide", () => held && navigator.sendBeacon("told", JSON.stringify(["drag", said(null)])));
})();
