// Search in files that are opened without a server: browsers start no workers there, so a hidden frame takes the place of one.
if (location.protocol === "file:") {
  const load = (page, url) =>
    new Promise((done) => {
      const script = page.createElement("script");
      script.onload = done;
      script.src = url;
      page.head.append(script);
    });

  window.IFrameWorker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.append(frame);
      this.inside = frame.contentWindow;
      this.inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      this.inside.importScripts = async (...urls) => {
        for (const each of urls) await load(this.inside.document, each);
      };
      this.ready = load(this.inside.document, new URL(url, location.href));
    }

    async postMessage(data) {
      await this.ready;
      this.inside.dispatchEvent(new MessageEvent("message", { data }));
    }
  };
  window.Worker = window.IFrameWorker;
}
