// A pad to drive by: arrows with Q and E, a gamepad, a stick under a finger. It says ten times a second how it is held,
// each part from -1 to 1, and that the robot shall stand once a key is up, or pad, tab or window are left.
window.drivePad = (pad) => {
  const keys = { ArrowUp: [1, 0, 0], ArrowDown: [-1, 0, 0], ArrowLeft: [0, 0, 1], ArrowRight: [0, 0, -1], KeyQ: [0, 1, 0], KeyE: [0, -1, 0] };
  const [stick, knob] = [pad.querySelector(".pendant-stick"), pad.querySelector(".pendant-knob")];
  const down = new Set();
  let finger = [0, 0, 0];
  let said = "0,0,0";
  const within = (part) => Math.max(-1, Math.min(1, part));
  const heard = (part) => (Math.abs(part ?? 0) < 0.15 ? 0 : part); // a stick at rest is never quite so
  const gamepad = () => {
    const one = [...navigator.getGamepads()].find((each) => each?.connected);
    return one ? [-heard(one.axes[1]), -heard(one.axes[2]), -heard(one.axes[0])] : [0, 0, 0];
  };
  const held = () => {
    if (!document.hasFocus() || document.hidden || !pad.contains(document.activeElement)) return [0, 0, 0];
    const parts = [finger, gamepad(), ...[...down].map((code) => keys[code])];
    return [0, 1, 2].map((axis) => within(parts.reduce((sum, part) => sum + part[axis], 0)));
  };
  const tell = () => {
    const now = held().map((part) => Math.round(100 * part) / 100 + 0);
    knob.style.transform = `translate(${-40 * now[2]}px, ${-40 * now[0]}px)`;
    if (said === "0,0,0" && `${now}` === said) return;
    said = `${now}`;
    pad.dispatchEvent(new CustomEvent("steer", { detail: now }));
  };
  const let_go = () => { down.clear(); finger = [0, 0, 0]; tell(); };
  pad.addEventListener("keydown", (event) => {
    if (!(event.code in keys) || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    event.stopPropagation();
    down.add(event.code);
    tell();
  });
  pad.addEventListener("keyup", ({ code }) => { down.delete(code); tell(); });
  pad.addEventListener("focusout", (event) => pad.contains(event.relatedTarget) || let_go());
  const point = ({ clientX, clientY }) => {
    const { left, top, width, height } = stick.getBoundingClientRect();
    finger = [within(1 - (2 * (clientY - top)) / height), 0, within(1 - (2 * (clientX - left)) / width)];
    tell();
  };
  stick.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    pad.focus();
    stick.setPointerCapture(event.pointerId);
    point(event);
  });
  stick.addEventListener("pointermove", (event) => stick.hasPointerCapture(event.pointerId) && point(event));
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) stick.addEventListener(end, let_go);
  for (const side of pad.querySelectorAll("[data-key]")) {
    side.addEventListener("pointerdown", (event) => { event.preventDefault(); pad.focus(); down.add(side.dataset.key); tell(); });
    for (const end of ["pointerup", "pointerleave", "pointercancel"]) side.addEventListener(end, () => { down.delete(side.dataset.key); tell(); });
  }
  window.addEventListener("blur", let_go);
  document.addEventListener("visibilitychange", let_go);
  const clock = setInterval(() => (pad.isConnected ? tell() : clearInterval(clock)), 100);
};
