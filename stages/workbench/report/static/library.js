// The plotting library: compressed text in the page, which is shown first; figures come right after.
"use strict";

(() => {
  let started = null;

  // Resolves when the browser has painted; a page in the background does not paint, and does not wait for ever.
  const shown = () => new Promise((resolve) => {
    requestAnimationFrame(() => setTimeout(resolve, 20));
    setTimeout(resolve, 1500);
  });

  /** What was deflated, as a Response. */
  b23d.inflated = (bytes) => new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate")));

  // Seven bits a character: pictures/packing.py, as_text.
  function septets(text) {
    const bytes = new Uint8Array(Math.floor((7 * text.length) / 8));
    let held = 0, bits = 0, at = 0;
    for (let i = 0; i < text.length; i++) {
      held = ((held << 7) | (text.charCodeAt(i) & 127)) & 0x3fff;
      bits += 7;
      if (bits >= 8) bytes[at++] = (held >> (bits -= 8)) & 255;
    }
    return bytes;
  }

  /** Resolves when `Plotly` is there. */
  b23d.plotly = () => {
    started ||= shown().then(async () => {
      const script = document.createElement("script"), text = document.getElementById("plotly");
      script.textContent = await b23d.inflated(septets(text.textContent)).text();
      document.head.append(script);
      text.remove();
    });
    return started;
  };
})();
