"use strict";
// Draws the chart of the page from the JSON that the page holds. Nothing is fetched.
(() => {
  document.documentElement.classList.add("js");
  const held = JSON.parse(document.getElementById("charts")?.textContent ?? "{}");

  const rule = "var(--rule)", text = "var(--text)", font = { labelColor: text, titleColor: text, labelFontSize: 12 };
  const config = {
    font: "system-ui, sans-serif", background: "transparent", view: { stroke: rule },
    axis: { ...font, domainColor: rule, tickColor: rule, gridColor: rule, gridOpacity: .35, titleFontSize: 13, titleFontWeight: "normal", tickCount: 6 },
    legend: { ...font, labelLimit: 260, orient: "bottom", symbolSize: 70, padding: 2, title: null, layout: { bottom: { direction: "vertical", anchor: "start" } } },
  };
  const options = { config, mode: "vega-lite", ast: true, renderer: "svg", actions: false, defaultStyle: false, tooltip: { disableDefaultStyle: true } };

  const draw = async place => {
    const spec = held[place.closest("[data-chart]").dataset.chart][place.dataset.view];
    await vegaEmbed(place.querySelector(".drawing"), spec, options);
    // the index of a symbol of one letter is set low; words with an underscore are left alone
    for (const word of place.querySelectorAll("text")) word.innerHTML = word.innerHTML.replace(/\b([A-Za-z])_([A-Za-z0-9])\b(.*)/, '$1<tspan dy="3" font-size="75%">$2</tspan><tspan dy="-3">$3</tspan>');
  };

  // Arrow keys go from mark to mark and say each one; Escape leaves.
  const walk = place => {
    let at = -1;
    const drawing = place.querySelector(".drawing"), said = place.querySelector("[aria-live]");
    const pointed = (mark, what) => {
      const box = mark.getBoundingClientRect();
      const where = { bubbles: true, clientX: box.x + box.width / 2, clientY: box.y + box.height / 2 };
      mark.dispatchEvent(new PointerEvent(what, where));
    };
    drawing.addEventListener("keydown", event => {
      const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1, Home: -Infinity, End: Infinity, Escape: 0 }[event.key];
      if (step === undefined || event.target !== drawing) return;
      event.preventDefault();
      for (const mark of place.querySelectorAll(".pointed")) mark.classList.remove("pointed");
      const centre = mark => { const box = mark.getBoundingClientRect(); return box.x; };
      const marks = [...place.querySelectorAll(`[aria-roledescription="cell"]`)].sort((a, b) => centre(a) - centre(b));
      if (!marks.length) return;
      if (step === 0) { if (at >= 0 && marks[at]) pointed(marks[at], "pointerout"); at = -1; said.textContent = ""; return; }
      at = Math.min(Math.max(at + step, 0), marks.length - 1);
      marks[at].classList.add("pointed");
      pointed(marks[at], "pointermove");
      said.textContent = marks[at].getAttribute("aria-label");
    });
  };
  for (const place of document.querySelectorAll("[data-view].view")) walk(place);

  // A link's target is unfolded: a chapter, the only one of a part, or whatever hides it.
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

  // A number shows its product and key where it is pointed at, and leads to the file where it is clicked.
  const cited = document.getElementById("source");
  addEventListener("pointerover", event => {
    const number = event.target.closest?.("[data-source]");
    if (number && !number.title) number.title = [number.dataset.source, number.dataset.how].filter(Boolean).join(", ");
  });
  addEventListener("click", event => {
    const number = event.target.closest("[data-source]"), away = event.target.closest("#source");
    if (!cited || away || event.target.closest("a, summary")) return;
    cited.hidden = !number;
    if (!number) return;
    const file = number.dataset.source.split("#")[0], link = Object.assign(document.createElement("a"), { textContent: file, href: document.body.dataset.products + file });
    cited.replaceChildren(number.value ? `${number.value} ` : "", "from ", file.endsWith(".toml") ? file : link, ` ${number.dataset.source.slice(file.length + 1)} ${number.dataset.how ?? ""}`);
  });

  // On paper nothing can be unfolded: short parts are opened, long ones stay one line.
  const unfolded = [];
  addEventListener("beforeprint", () => {
    for (const fold of document.querySelectorAll("main details:not([open])")) {
      if (fold.matches(".chapter") || fold.querySelectorAll("tr, li").length <= 40) { fold.open = true; unfolded.push(fold); }
    }
  });
  addEventListener("afterprint", () => { for (const fold of unfolded.splice(0)) fold.open = false; });

  document.documentElement.dataset.charts = "drawing";
  reveal();
  Promise.all([...document.querySelectorAll("[data-view].view")].map(draw)).then(() => { document.documentElement.dataset.charts = "drawn"; });
})();
