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
  const obey = (command) => {
    if (typeof command === "string") viewer.handle_command_bytearray(bytes(command));
    else if (command.type === "asset") casAssets[command.name] = command.url;
    else viewer.handle_command(command);
    if (command.type === "set_control") viewer.gui.open();
  };
  const events = new EventSource("events");
  events.onmessage = ({ data }) => JSON.parse(data).forEach(obey);
  events.addEventListener("end", () => {
    events.close();
    document.title = "ended";
  });
})();
