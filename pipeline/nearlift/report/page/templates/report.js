"use strict";
// Draws each chart of the page from the JSON that the page holds, and binds native inputs to its signals. Nothing is fetched.
(() => {
  document.documentElement.classList.add("js");
  const held = JSON.parse(document.getElementById("charts")?.textContent ?? "{}");
  const live = new Map();

  const rows = columns => {
    const names = Object.keys(columns);
    columns = Object.fromEntries(names.map(n => [n, columns[n].of ? columns[n].at.map(i => columns[n].of[i]) : columns[n]]));
    return names.length ? columns[names[0]].map((_, i) => Object.fromEntries(names.map(name => [name, columns[name][i]]))) : [];
  };

  // What the inputs of a chart say for one of its views.
  const chosen = (figure, view) => {
    const found = {};
    for (const input of figure.querySelectorAll("input[data-signal]")) {
      if (input.dataset.view && input.dataset.view !== view) continue;
      const name = input.dataset.signal;
      if (input.type === "radio") { if (input.checked) found[name] = input.value; }
      else if (input.dataset.switch) found[name] = input.checked;
      else { found[name] ??= []; if (input.checked) found[name].push(input.value); }
    }
    return found;
  };

  // The ordinate reaches as far as the points shown, with their uncertainties.
  const limits = (cells, state) => {
    const { field, per } = state, ends = cells.filter(c => state.throttles.includes(c.throttle));
    if (!ends.length) return {};
    const low = per * Math.min(...ends.map(c => c[field] - c["u_" + field])), high = per * Math.max(...ends.map(c => c[field] + c["u_" + field]));
    const room = 0.05 * (high - low || 1);
    return { low: low - room, high: high + room };
  };

  const state = (figure, view, data) => {
    const now = chosen(figure, view);
    for (const [signal, by] of Object.entries(held[figure.dataset.chart][view].follows)) Object.assign(now, by[now[signal]]);
    return now.quantity ? { ...now, ...limits(data.cells, now) } : now;
  };

  // What no signal can change, such as the kind of an axis, is written into the text; where that changes, the chart is drawn anew.
  const written = (kept, now) => JSON.stringify(kept, (_, v) => (typeof v === "string" && v.startsWith("$") ? now[v.slice(1)] : v));

  const specification = (text, now, data) => {
    const spec = JSON.parse(text);
    for (const parameter of spec.params) if (parameter.name in now) parameter.value = now[parameter.name];
    return { ...spec, datasets: data };
  };

  const options = { mode: "vega-lite", ast: true, renderer: "svg", actions: false, defaultStyle: false, tooltip: { disableDefaultStyle: true } };

  const draw = async (place, width) => {
    const figure = place.closest("[data-chart]"), kept = held[figure.dataset.chart][place.dataset.view];
    const data = Object.fromEntries(Object.entries(kept.data).map(([name, columns]) => [name, rows(columns)]));
    const now = state(figure, place.dataset.view, data), text = written(kept.spec, now);
    live.get(place)?.result.finalize();
    const spec = specification(text, now, data), height = place.closest(".card") ? 215 : spec.height;
    const result = await vegaEmbed(place.querySelector(".drawing"), { ...spec, height, ...(width && { width }) }, options);
    live.set(place, { result, data, text, rough: Boolean(width), kept: kept.spec, names: kept.spec.params.map(p => p.name) });
  };

  const refresh = async place => {
    const { result, data, text, kept, names } = live.get(place);
    const now = state(place.closest("[data-chart]"), place.dataset.view, data);
    if (written(kept, now) !== text) return draw(place);
    for (const name of names) if (name in now) result.view.signal(name, now[name]);
    await result.view.runAsync();
  };

  // Arrow keys go from point to point and say each one, left and right along one kind of mark, up and down along the other; Escape leaves.
  const walk = place => {
    let at = -1, kind = place.dataset.across;
    const said = place.querySelector("[aria-live]");
    const pointed = (mark, what) => {
      const box = mark.getBoundingClientRect();
      const where = { bubbles: true, clientX: box.x + box.width / 2, clientY: box.y + box.height / 2 };
      mark.dispatchEvent(new PointerEvent(what, where));
    };
    place.querySelector(".drawing").addEventListener("keydown", event => {
      const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1, Home: -Infinity, End: Infinity, Escape: 0 }[event.key];
      if (step === undefined) return;
      event.preventDefault();
      for (const mark of place.querySelectorAll(".pointed")) mark.classList.remove("pointed");
      const along = { ArrowRight: "across", ArrowLeft: "across", ArrowDown: "among", ArrowUp: "among" }[event.key];
      if (along && place.dataset[along] !== kind) { kind = place.dataset[along]; at = -1; }
      const centre = mark => { const box = mark.getBoundingClientRect(); return place.dataset.down ? box.y + box.height / 2 : box.x + box.width / 2; };
      const marks = [...place.querySelectorAll(`[aria-roledescription="${kind}"]`)].sort((a, b) => centre(a) - centre(b));
      if (!marks.length) return;
      if (step === 0) { if (at >= 0 && marks[at]) pointed(marks[at], "pointerout"); at = -1; said.textContent = ""; return; }
      at = Math.min(Math.max(at + step, 0), marks.length - 1);
      marks[at].classList.add("pointed");
      pointed(marks[at], "pointermove");
      said.textContent = marks[at].getAttribute("aria-label");
    });
  };

  for (const figure of document.querySelectorAll("[data-chart]")) {
    const places = [...figure.querySelectorAll("[data-view].view")];
    for (const place of places) walk(place);
    figure.addEventListener("change", event => {
      const view = event.target.dataset.view;
      for (const place of places) if (!view || place.dataset.view === view) refresh(place);
    });
    for (const button of figure.querySelectorAll("button[data-all]")) {
      button.addEventListener("click", () => {
        const inputs = button.closest("fieldset").querySelectorAll("input[data-signal]");
        for (const input of inputs) input.checked = button.dataset.all === "yes";
        inputs[0].dispatchEvent(new Event("change", { bubbles: true }));
      });
    }
  }

  for (const button of document.querySelectorAll("button[data-copies]")) {
    button.hidden = !navigator.clipboard;
    button.addEventListener("click", async () => {
      await navigator.clipboard.writeText(document.getElementById(button.dataset.copies).textContent.trim());
      button.textContent = "Copied";
    });
  }

  // What a link leads to is unfolded: a chapter, the only one of a part, or whatever hides it.
  const reveal = () => {
    const found = location.hash.length > 1 && document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (!found) return;
    const own = found.querySelectorAll("details.chapter");
    if (own.length === 1) own[0].open = true;
    for (let fold = found.closest("details"); fold; fold = fold.parentElement.closest("details")) fold.open = true;
    found.scrollIntoView();
  };
  addEventListener("hashchange", reveal);
  for (const link of document.querySelectorAll("a[href^='#']")) link.addEventListener("click", () => { if (link.hash === location.hash) reveal(); });

  const menu = document.querySelector("nav button");
  if (menu) {
    const show = open => menu.setAttribute("aria-expanded", open);
    menu.hidden = false;
    menu.addEventListener("click", () => show(menu.getAttribute("aria-expanded") !== "true"));
    menu.parentElement.addEventListener("click", event => { if (event.target.closest("a")) show(false); });
    menu.parentElement.addEventListener("keydown", event => { if (event.key === "Escape") { show(false); menu.focus(); } });
  }

  // A number tells its product and key where it is pointed at, and leads to the file where it is clicked.
  const told = document.getElementById("source");
  addEventListener("pointerover", event => {
    const number = event.target.closest?.("[data-source]");
    if (number && !number.title) number.title = [number.dataset.source, number.dataset.how].filter(Boolean).join(", ");
  });
  addEventListener("click", event => {
    const number = event.target.closest("[data-source]"), away = event.target.closest("#source");
    if (!told || away || event.target.closest("a, summary")) return;
    told.hidden = !number;
    if (!number) return;
    const file = number.dataset.source.split("#")[0], link = Object.assign(document.createElement("a"), { textContent: file, href: document.body.dataset.products + file });
    told.replaceChildren(number.value ? `${number.value} ` : "", "from ", file.endsWith(".toml") ? file : link, ` ${number.dataset.source.slice(file.length + 1)} ${number.dataset.how ?? ""}`);
  });

  // A chart takes the width of its place, and is drawn anew when that is unfolded.
  const all = [...document.querySelectorAll("[data-view].view")], lies = place => place.closest("details.chapter:not([open])");
  const drawn = (places, width) => Promise.all(places.filter(p => !live.has(p) || (live.get(p).rough && !width)).map(p => draw(p, width)));
  for (const fold of document.querySelectorAll("details.chapter")) {
    fold.addEventListener("toggle", () => { if (fold.open) drawn(all.filter(p => fold.contains(p))); });
  }

  // On paper nothing can be unfolded: what is short stands there, what is long stays a line that says how much there is.
  const unfolded = [];
  addEventListener("beforeprint", () => {
    for (const fold of document.querySelectorAll("main details:not([open])")) {
      if (fold.matches(".chapter") || (!fold.closest("[data-chart]") && fold.querySelectorAll("tr, li").length <= 40)) { fold.open = true; unfolded.push(fold); }
    }
  });
  addEventListener("afterprint", () => { for (const fold of unfolded.splice(0)) fold.open = false; });

  document.documentElement.dataset.charts = "drawing";
  reveal();
  drawn(all.filter(p => !lies(p))).then(() => {
    document.documentElement.dataset.charts = "drawn";
    // paper shows what is folded, and does not wait for a drawing: each has one by then
    (window.requestIdleCallback ?? setTimeout)(() => drawn(all, 340));
  });
})();
