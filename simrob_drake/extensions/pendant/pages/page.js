// Keys press the buttons that say so in aria-keyshortcuts, wherever the focus is; where something is typed, those with Alt.
(() => {
  const called = ({ key, ctrlKey, metaKey, altKey, shiftKey }) => {
    const name = key === " " ? "Space" : key.length === 1 ? key.toUpperCase() : key;
    const letter = /^([A-Z]|..+)$/.test(name); // what Shift makes another sign of is that sign
    return [(ctrlKey || metaKey) && "Control", altKey && "Alt", shiftKey && letter && "Shift", name].filter(Boolean).join("+");
  };
  const takes = (target, key) => {
    if (target.closest?.("input, textarea, select, [contenteditable]")) return !key.startsWith("Alt+"); // types nothing
    return (key === "Space" || key === "Enter") && target.closest?.("button, a, summary, [role], [tabindex='0']");
  };
  window.pressed = (event) => {
    const key = called(event);
    if (takes(event.target, key) || document.querySelector(".q-dialog")) return;
    const button = document.querySelector(`[aria-keyshortcuts="${CSS.escape(key)}"]`);
    if (!button || button.disabled || !button.checkVisibility()) return;
    event.preventDefault();
    button.click();
  };
  document.addEventListener("keydown", window.pressed);
  // The focus of a slider is on a part of it that has neither name nor value, so that screen readers would read nothing.
  const READ = ["role", "aria-label", "aria-valuemin", "aria-valuemax", "aria-valuenow"];
  let readings = null;
  const read = (part) => {
    readings?.disconnect();
    const slider = part.closest(".q-slider");
    if (!slider || slider === part) return;
    const { text, unit } = slider.dataset; // a label with the value, or the unit of the value
    const label = text ? document.getElementById(text) : null;
    const copy = () => {
      READ.forEach((name) => {
        if (slider.hasAttribute(name)) part.setAttribute(name, slider.getAttribute(name));
      });
      const value = label?.textContent ?? (unit && `${slider.getAttribute("aria-valuenow")} ${unit}`);
      if (value) part.setAttribute("aria-valuetext", value);
    };
    copy();
    readings = new MutationObserver(copy);
    readings.observe(slider, { attributeFilter: READ });
    if (label) readings.observe(label, { characterData: true, childList: true, subtree: true });
  };
  // A part of the page that is drawn anew takes the focus away. The element of the same name in the new part gets it.
  const path_of = (element) => {
    const { block } = element.dataset ?? {};
    if (block !== undefined) return `[data-block="${CSS.escape(block)}"]`;
    const named = element.parentElement?.closest("[aria-label]");
    const own = element.matches(".q-slider__track-container") ? "" : element.getAttribute("aria-label");
    if (own) return `[aria-label="${CSS.escape(own)}"]`;
    const kind = `${element.localName}${element.classList.length ? `.${CSS.escape(element.classList[0])}` : ""}`;
    return named ? `[aria-label="${CSS.escape(named.getAttribute("aria-label"))}"] ${kind}` : "";
  };
  let focused = null; // last element with the focus, its path, and its number among those of the same path
  document.addEventListener("focusin", ({ target }) => {
    const path = path_of(target);
    focused = path ? { target, path, number: [...document.querySelectorAll(path)].indexOf(target) } : null;
    read(target);
  });
  document.addEventListener("pointerdown", () => { focused = null; }, true);
  new MutationObserver(() => {
    if (!focused || focused.target.isConnected || document.activeElement !== document.body) return;
    document.querySelectorAll(focused.path)[focused.number]?.focus({ preventScroll: true });
  }).observe(document, { childList: true, subtree: true });
  setInterval(async () => { // a server that was started anew refuses this page, and says which one to open
    if (document.getElementById("popup")?.ariaHidden !== "false") return;
    const answer = await fetch(location.href, { cache: "no-store" }).catch(() => null);
    if (answer?.status === 403) location.reload();
  }, 2000);
  // Without a connection nothing can be pressed: a click would be lost, or arrive late. A click just before the loss may
  // not have arrived. The page says so once the connection is back, also if it is loaded again for that.
  const parts = ".pendant-bar, .pendant-conflict, .pendant-tour, .pendant-main";
  const flag = "lost-click"; // name in the session's storage, and class of the body that shows the notice
  let clicked = -Infinity; // time of the last click [ms]
  let heard = 0; // time of the last message of the server [ms]
  const show_lost_click = () => {
    document.body.classList.toggle(flag, sessionStorage.getItem(flag) !== null);
    sessionStorage.removeItem(flag);
  };
  const connection = (is_lost) => {
    document.querySelectorAll(parts).forEach((part) => (part.inert = is_lost));
    document.body.classList.toggle("offline", is_lost);
    if (!is_lost) show_lost_click();
    else if (clicked > heard) sessionStorage.setItem(flag, "");
  };
  document.addEventListener("click", ({ target }) => {
    document.body.classList.remove(flag);
    if (target.closest?.("button, input, [role]")) clicked = performance.now();
  }, true);
  window.addEventListener("load", () => {
    show_lost_click();
    window.socket?.onAny(() => { heard = performance.now(); });
    const popup = document.getElementById("popup");
    const look = () => connection(popup.ariaHidden === "false");
    if (popup) new MutationObserver(look).observe(popup, { attributeFilter: ["aria-hidden"] });
  });
  // The view is as high as what the header and the strip of a lesson leave of the window, so that its buttons are seen.
  const measure = () => {
    const high = (name) => document.querySelector(name)?.offsetHeight ?? 0;
    const style = document.documentElement.style;
    style.setProperty("--stuck", `${high(".pendant-stays")}px`);
    style.setProperty("--strip", `${high(".pendant-tour")}px`);
    style.setProperty("--above", `${high(".pendant-bar") + high(".pendant-conflict") + high(".pendant-tour")}px`);
  };
  window.addEventListener("load", () => {
    const sizes = new ResizeObserver(measure);
    document.querySelectorAll(".pendant-bar, .pendant-conflict, .pendant-tour, .pendant-stays").forEach((place) => sizes.observe(place));
    measure();
  });
  // A finger cannot rest on a disabled button to read its title. A tap shows the title as a notice. The browser sends no
  // click from a disabled button, so the element is looked up by position; a swipe ends with pointercancel instead.
  const NOTICE_TIME = 5000; // [ms]
  let notice = null;
  const show_notice = (text) => {
    notice?.remove();
    const shown = document.body.appendChild(document.createElement("div"));
    notice = shown;
    shown.className = "pendant-notice";
    shown.setAttribute("role", "status");
    shown.textContent = text;
    setTimeout(() => shown.remove(), NOTICE_TIME);
  };
  document.addEventListener("pointerup", ({ pointerType, clientX, clientY }) => {
    if (pointerType !== "touch") return;
    const button = document.elementFromPoint(clientX, clientY)?.closest("button:disabled[title]");
    if (button) show_notice(button.title);
    else notice?.remove();
  }, true);
  window.hasWebGL = () => !!document.createElement("canvas").getContext("webgl2");
  const dropped = (event) => { // files of the user's own
    if (!event.dataTransfer?.types.includes("Files")) return;
    event.preventDefault();
    const uploads = getElement(Number(document.querySelector(".pendant-own").id.slice(1)));
    if (event.type === "drop") uploads.$refs.qRef.addFiles(event.dataTransfer.files);
  };
  const takes_files = (place) => ["dragover", "drop"].forEach((name) => place.addEventListener(name, dropped));
  takes_files(document);
  window.viewShown = (frame) => {
    takes_files(frame.contentWindow);
    frame.contentWindow.addEventListener("keydown", window.pressed); // while it has the focus
    const shade = () => frame.contentWindow.shade?.(document.body.classList.contains("body--dark"));
    new MutationObserver(shade).observe(document.body, { attributeFilter: ["class"] });
    shade();
    frame.classList.add("shown"); // Meshcat's own look is past
  };
})();
