// Search where there is no server: from the file system a browser starts no worker, so a hidden frame is one.
"use strict";
(() => {
  if (location.protocol !== "file:") return;
  window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      this.waiting = [];
      this.frame = document.createElement("iframe");
      this.frame.hidden = true;
      document.body.append(this.frame);
      const inside = this.frame.contentWindow;
      inside.postMessage = (data) => this.later(data, (own) => this.tell("message", { data: own }));
      const script = inside.document.createElement("script");
      script.src = url;
      script.onerror = () => this.tell("error", {});
      script.onload = () => {
        const waiting = this.waiting;
        this.waiting = null;
        waiting.forEach((data) => this.postMessage(data));
      };
      inside.document.body.append(script);
    }

    tell(kind, more) {
      const event = new MessageEvent(kind, more);
      this["on" + kind]?.(event);
      this.dispatchEvent(event);
    }

    postMessage(data) {
      if (this.waiting) this.waiting.push(data);
      else this.later(data, (own) => this.frame.contentWindow?.dispatchEvent(new MessageEvent("message", { data: own })));
    }

    // as between threads: a copy, and never in the middle of what is being done
    later(data, tell) {
      const own = structuredClone(data);
      setTimeout(() => tell(own));
    }

    terminate() {
      this.frame.remove();
    }
  };
})();
