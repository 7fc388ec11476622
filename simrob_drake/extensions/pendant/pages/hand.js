// What a user does with the pointer in the view. A body is pulled while a run goes on, with Shift or in the mood for it
// (window.hand.pull). In the hand's mood (window.hand.on) handles have arrows and rings, and links turn about their joints.
(() => {
  viewer.gui.domElement.style.display = "none"; // the page around has what there is to set
  const three = MeshCat.THREE;
  const { Vector2, Vector3, Matrix4, Quaternion, Euler, Plane, Raycaster, Group, Mesh, Line, BufferGeometry } = three;
  const canvas = viewer.renderer.domElement;
  const CLICK = 4; // px that a pointer moves at most where nothing is dragged
  const caster = new Raycaster();
  const hand = { on: false, pull: false, own: false, step: 0, turn: 0 };
  const words = document.body.appendChild(document.createElement("div"));
  words.style = "position: absolute; bottom: 8px; left: 12px; padding: 2px 8px; border-radius: 6px; background: #ffffffd0; color: #1c2530; font: 15px sans-serif; pointer-events: none";
  const say = (text) => { words.textContent = text; words.hidden = !text; };
  say("");

  const aim = ({ clientX, clientY }) => {
    const { left, top, width, height } = canvas.getBoundingClientRect();
    caster.setFromCamera(new Vector2((2 * (clientX - left)) / width - 1, 1 - (2 * (clientY - top)) / height), viewer.camera);
  };
  const path = (object) => (object.parent ? `${path(object.parent)}/${object.name}` : ""); // from the scene down
  const seen = () => {
    const meshes = [];
    viewer.scene_tree.find(["drake"]).object.traverseVisible((object) => object.isMesh && meshes.push(object));
    return caster.intersectObjects(meshes, false)[0];
  };
  const picked = () => {
    const hit = seen();
    for (let body = hit?.object; body; body = body.parent) {
      const name = path(body);
      if (board.bodies.has(name)) return { body, name, at: hit.point, point: body.worldToLocal(hit.point.clone()) };
    }
    return null;
  };

  // A body that is pulled
  const line = new Line(new BufferGeometry(), new three.LineBasicMaterial({ color: 0xd0208a, depthTest: false, transparent: true }));
  line.frustumCulled = false;
  line.renderOrder = 1; // over all else
  const pull = (hit) => {
    const ahead = viewer.camera.getWorldDirection(new Vector3());
    const plane = new Plane().setFromNormalAndCoplanarPoint(ahead, hit.at);
    const report = (target) => ["drag", [hit.name, hit.point.toArray(), target && target.toArray()]];
    viewer.scene.add(line);
    return {
      move() {
        const target = caster.ray.intersectPlane(plane, new Vector3());
        if (!target) return;
        const local = viewer.scene.worldToLocal(target); // the scene's axes are Drake's
        line.geometry.setFromPoints([viewer.scene.worldToLocal(hit.body.localToWorld(hit.point.clone())), local]);
        window.tell(...report(local));
      },
      last: () => report(null),
      end: () => viewer.scene.remove(line),
    };
  };

  // How far the pointer is along an axis, or about it; null where it cannot be told
  const pointed = () => {
    const from = viewer.scene.worldToLocal(caster.ray.origin.clone());
    return [from, viewer.scene.worldToLocal(caster.ray.origin.clone().add(caster.ray.direction)).sub(from).normalize()];
  };
  const along = (point, axis) => {
    const [from, ray] = pointed();
    const [way, both] = [from.sub(point), axis.dot(ray)];
    return 1 - both * both < 1e-3 ? null : (axis.dot(way) - both * ray.dot(way)) / (1 - both * both);
  };
  const about = (centre, axis, begin) => { // from where it began, which lies off the axis; returns what tells it
    const arm = begin.clone().sub(centre).projectOnPlane(axis);
    const tangent = axis.clone().cross(arm).normalize();
    if (Math.abs(axis.dot(pointed()[1])) < 0.3) { // the circle is seen from its side
      return () => (arm.length() < 1e-3 ? null : along(begin, tangent) / arm.length());
    }
    return () => {
      const [from, ray] = pointed();
      const now = from.clone().addScaledVector(ray, axis.dot(centre.clone().sub(from)) / axis.dot(ray)).sub(centre);
      return Math.atan2(axis.dot(arm.clone().cross(now)), arm.dot(now));
    };
  };
  const snapped = (value, step) => (step ? Math.round(value / step) * step : value);
  const degrees = (angle) => (angle * 180) / Math.PI;
  const wound = (angle, last) => angle + 2 * Math.PI * Math.round((last - angle) / (2 * Math.PI)); // nearest to the last

  // Handles: a dot each, and arrows and rings about the one that is chosen
  const Y = new Vector3(0, 1, 0);
  const Z = new Vector3(0, 0, 1);
  const COLOURS = { tool: 0xf0a500, limb: 0xf0a500, piece: 0x8a4fd0, target: 0x1c9aa8 };
  const paint = (color) => new three.MeshBasicMaterial({ color, depthTest: false, transparent: true, opacity: 0.85 });
  const unseen = new three.MeshBasicMaterial({ visible: false });
  const gizmo = new Group();
  const dots = new Group();
  viewer.scene.add(gizmo, dots);
  gizmo.visible = false;
  const grips = [];
  [0xd03030, 0x2a9d2a, 0x2f6fd0].forEach((color, axis) => {
    const direction = new Vector3().setComponent(axis, 1);
    const shape = (geometry, from, material, turns, up) => {
      const mesh = new Mesh(geometry, material);
      mesh.quaternion.setFromUnitVectors(from, direction);
      mesh.position.copy(direction).multiplyScalar(up);
      mesh.renderOrder = 2;
      if (material === unseen) grips.push(Object.assign(mesh, { userData: { axis, turns } }));
      gizmo.add(mesh);
    };
    const solid = paint(color);
    shape(new three.CylinderGeometry(0.018, 0.018, 1), Y, solid, false, 0.5);
    shape(new three.ConeGeometry(0.07, 0.22), Y, solid, false, 1.1);
    shape(new three.TorusGeometry(0.72, 0.018, 8, 48), Z, solid, true, 0);
    shape(new three.CylinderGeometry(0.09, 0.09, 0.95), Y, unseen, false, 0.72);
    shape(new three.TorusGeometry(0.72, 0.07, 6, 48), Z, unseen, true, 0);
  });
  let [handles, links, chosen, held] = [{}, {}, "", null];
  const resize = () => { // as large on the screen wherever they are
    const far = (object) => object.getWorldPosition(new Vector3()).distanceTo(viewer.camera.position);
    const high = 2 * Math.tan(((viewer.camera.fov ?? 60) * Math.PI) / 360);
    for (const dot of dots.children) dot.scale.setScalar(0.012 * high * far(dot));
    gizmo.scale.setScalar(0.13 * high * far(gizmo));
  };
  const show = () => {
    dots.visible = hand.on;
    gizmo.visible = hand.on && chosen in handles;
    if (gizmo.visible) {
      const { position, rotation } = handles[chosen];
      gizmo.position.copy(position);
      gizmo.quaternion.copy(hand.own ? rotation : new Quaternion());
    }
    for (const dot of dots.children) dot.position.copy(handles[dot.name].position);
    viewer.scene.updateMatrixWorld(true);
    resize();
    viewer.set_dirty();
  };
  viewer.controls.addEventListener("change", resize);
  board.heard.handles = ({ handles: told, links: known }) => {
    links = known;
    const kept = held?.handle && handles[held.handle];
    handles = {};
    for (const [name, { pose, path: body }] of Object.entries(told)) {
      const [position, rotation] = [new Vector3(), new Quaternion()];
      new Matrix4().fromArray(pose).decompose(position, rotation, new Vector3());
      handles[name] = { position, rotation, path: body };
    }
    if (kept && held.handle in handles) Object.assign(handles[held.handle], kept);
    if (kept && !(held.handle in handles)) cancel(); // the station is built anew while a handle is dragged
    dots.clear();
    for (const name of Object.keys(handles)) {
      const dot = new Mesh(new three.SphereGeometry(1), paint(COLOURS[name.split(":")[0]]));
      dots.add(Object.assign(dot, { name, renderOrder: 2 }));
    }
    for (const name of Object.keys(handles).filter((one) => one !== held?.handle)) carry(name);
    show();
  };
  const matrix = ({ position, rotation }) => new Matrix4().compose(position, rotation, new Vector3(1, 1, 1));
  const offsets = {}; // of the bodies of pieces that were moved here, from their handles
  const carry = (name) => {
    const offset = offsets[name];
    if (!offset || !handles[name].path) return;
    const placed = matrix(handles[name]).multiply(offset).toArray();
    viewer.handle_command({ type: "set_transform", path: handles[name].path, matrix: placed });
  };
  const put = (handle, turned, over) => {
    const { position, rotation } = handles[handle];
    const { x, y, z } = new Euler().setFromQuaternion(rotation, "ZYX");
    return ["put", [handle, [...position.toArray(), ...[z, y, x].map(degrees)], turned, over]];
  };
  const name_of = (handle) => handle.replace(/^(tool):$/, "$1").replace(/^\w+:(.)/, "$1").replaceAll("_", " ");
  const grip = (handle, { axis, turns }) => {
    const begin = { position: handles[handle].position.clone(), rotation: handles[handle].rotation.clone() };
    const direction = new Vector3().setComponent(axis, 1).applyQuaternion(gizmo.quaternion);
    const centre = begin.position.clone();
    const spot = turns ? viewer.scene.worldToLocal(caster.intersectObjects(grips, false)[0].point.clone()) : null;
    const turned = turns && about(centre, direction, spot);
    const first = turns ? 0 : along(centre, direction);
    let last = first;
    const body = handles[handle].path && viewer.scene_tree.find(handles[handle].path.split("/").filter(Boolean)).object;
    if (body) offsets[handle] ??= matrix(begin).invert().multiply(new Matrix4().copy(body.matrix));
    return {
      handle,
      still: true,
      move() {
        const now = turns ? turned() : along(centre, direction);
        if (now === null || first === null) return;
        last = turns ? wound(now, last) : now;
        const by = turns ? (snapped(degrees(last - first), hand.turn) * Math.PI) / 180 : snapped(last - first, hand.step / 1e3);
        const moved = handles[handle];
        if (turns) moved.rotation.setFromAxisAngle(direction, by).multiply(begin.rotation);
        else moved.position.copy(begin.position).addScaledVector(direction, by);
        carry(handle);
        show();
        say(`${name_of(handle)}: ${"xyz"[axis]} ${turns ? `${degrees(by).toFixed(1)}°` : `${(1e3 * by).toFixed(1)} mm`}`);
        window.tell(...put(handle, turns, false));
      },
      last: () => put(handle, turns, true),
      end: () => say(""),
    };
  };
  const bend = (hit) => {
    const { axis, point, along: way, turns, value, low, high } = links[hit.name];
    const [centre, direction] = [new Vector3(...point), new Vector3(...way)];
    const spot = viewer.scene.worldToLocal(hit.at.clone());
    let [last, target] = [0, value];
    const turned = turns && about(centre, direction, spot);
    const first = turns ? 0 : along(spot, direction) ?? 0;
    const report = () => ["turn", [axis, target]];
    return {
      still: true,
      move() {
        const now = turns ? turned() : along(spot, direction);
        if (now === null) return;
        last = turns ? wound(now, last) : now - first;
        const whole = snapped(value + (turns ? degrees(last) : last), turns ? hand.turn : hand.step / 1e3);
        target = Math.min(Math.max(whole, low ?? -Infinity), high ?? Infinity);
        say(`${axis.replaceAll("_", " ")}: ${turns ? `${target.toFixed(1)}°` : `${(1e3 * target).toFixed(1)} mm`}`);
        window.tell(...report());
      },
      last: report,
      end: () => say(""),
    };
  };

  const taken = (event) => {
    if (event.shiftKey || hand.pull) return (hit => hit && pull(hit))(picked());
    if (!hand.on) return null;
    const [part] = gizmo.visible ? caster.intersectObjects(grips, false) : [];
    if (part) return grip(chosen, part.object.userData);
    const under = [...new Set(caster.intersectObjects(dots.children, false).map(({ object }) => object.name))].sort();
    const hit = picked();
    const dot = under[(under.indexOf(chosen) + 1) % under.length]; // of several another one with each click
    const found = dot ?? Object.keys(handles).find((name) => hit && handles[name].path === hit.name);
    if (found) {
      chosen = found;
      show();
      return { move() {}, end() {} };
    }
    return hit && hit.name in links ? bend(hit) : null;
  };
  const cancel = () => { // nothing is reported of a drag whose handle is gone
    const { end: done } = held;
    held = null;
    board.held = false;
    done();
  };
  const end = () => {
    if (!held) return;
    const { last, still, end: done } = held;
    held = null;
    board.held = false;
    if (last && !still) window.tell(...last());
    done();
    viewer.set_dirty();
  };
  const move = (event) => {
    if (!held) return;
    held.still &&= Math.hypot(event.clientX - held.from[0], event.clientY - held.from[1]) < CLICK;
    if (held.still) return;
    aim(event);
    held.move();
    viewer.set_dirty();
  };
  const start = (event) => {
    if (event.button !== 0) return;
    aim(event);
    held = taken(event);
    if (!held) return;
    board.held = true;
    held.from = [event.clientX, event.clientY];
    event.stopImmediatePropagation();
    event.preventDefault();
    canvas.setPointerCapture(event.pointerId);
    move(event);
  };
  canvas.addEventListener("pointerdown", start, true);
  canvas.addEventListener("pointermove", move, true);
  ["pointerup", "pointercancel", "lostpointercapture"].forEach((name) => canvas.addEventListener(name, end, true));
  window.addEventListener("blur", end);
  window.addEventListener("pagehide", () => held?.last && !held.still && navigator.sendBeacon("told", JSON.stringify(held.last())));
  canvas.addEventListener("dblclick", (event) => { // the view turns about what was clicked
    aim(event);
    const hit = seen();
    if (!hit) return;
    viewer.controls.target.copy(hit.point);
    viewer.controls.update();
    viewer.set_dirty();
  });
  window.setHand = (settings) => {
    Object.assign(hand, settings);
    show();
  };
})();
