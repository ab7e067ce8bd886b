"use strict";
// What the pages do beyond forms and links: copying, events of the server, plots. Nothing is fetched from elsewhere.
(() => {
  const $ = (selector, within = document) => within.querySelector(selector);
  const all = (selector, within = document) => [...within.querySelectorAll(selector)];
  const data = document.body.dataset;

  for (const button of all("[data-copy]")) {
    button.hidden = !navigator.clipboard;
    button.addEventListener("click", async () => {
      await navigator.clipboard.writeText($("code", button.parentElement).textContent);
      button.textContent = "Copied";
    });
  }

  // A command at work: its lines, the stage it is in, and how long those took the last time.
  const work = () => {
    const log = $("#log"), bar = $("progress"), state = $("#state"), stages = all("[data-stage]");
    const events = new EventSource(`/events/work?key=${encodeURIComponent(data.key)}`);
    let current = null, began = 0;
    log.textContent = "";
    const enter = (stage, done) => {
      if (current) { current.className = "done"; current.removeAttribute("aria-current"); }
      if (done) { stage.className = "done"; $("span", stage).textContent = "up to date"; return; }
      current = stage; began = performance.now();
      current?.setAttribute("aria-current", "step");
    };
    const left = share => {
      if (!current) return "";
      const spent = (performance.now() - began) / 1000, last = Number(current.dataset.seconds);
      const own = share > 0.02 ? spent * (1 - share) / share : last - spent;
      const later = stages.slice(stages.indexOf(current) + 1).reduce((sum, s) => sum + Number(s.dataset.seconds), 0);
      const seconds = Math.max(own, 0) + later;
      return last || share ? `, about ${seconds < 90 ? `${Math.ceil(seconds)} s` : `${Math.round(seconds / 60)} min`} left` : "";
    };
    events.addEventListener("lines", event => {
      for (const line of JSON.parse(event.data)) {
        const stage = stages.find(s => line.startsWith(s.dataset.stage.padEnd(9))), part = /(\d+) of (\d+)/.exec(line);
        if (stage) enter(stage, line.trimEnd().endsWith("up to date"));
        bar.hidden = !part;
        if (part) bar.value = part[1] / part[2];
        state.textContent = line.trim().slice(0, 120) + left(part ? part[1] / part[2] : 0);
        log.append(`${line}\n`);
      }
      log.scrollTop = log.scrollHeight;
    });
    events.addEventListener("ended", event => {
      const { code, result } = JSON.parse(event.data);
      events.close();
      bar.hidden = $("#cancel").hidden = true;
      if (current) { current.className = "done"; current.removeAttribute("aria-current"); }
      state.textContent = { 0: "done", 3: "done, some trials rejected", 130: "cancelled; finished products stand" }[code] ?? `refused (${code}): its last lines say why`;
      $("#result").hidden = !(result && [0, 3].includes(code));
      if (!$("#result").hidden && !sessionStorage.getItem(data.key)) { sessionStorage.setItem(data.key, "1"); location.href = result; }
    });
  };

  ({ work })[data.page]?.();
})();
