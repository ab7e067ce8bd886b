"use strict";
// Ask every few seconds whether the campaign has changed, and show its new state. No connection stays open.
const PERIOD_MS = 3000;
const state = document.querySelector("#state");

const refresh = async () => {
  const live = document.querySelector("#live"), address = new URL(location.href);
  address.searchParams.set("seen", live.dataset.stamp);
  const answer = await fetch(address, { signal: AbortSignal.timeout(30000) });
  if (!answer.ok) throw new Error(answer.statusText);
  if (answer.status === 204) return;
  const page = new DOMParser().parseFromString(await answer.text(), "text/html"), focused = document.activeElement.id;
  live.replaceWith(page.querySelector("#live"));
  if (focused) document.getElementById(focused)?.focus({ preventScroll: true });
  const words = page.querySelector("#state").textContent;
  if (state.textContent !== words) state.textContent = words;
};

const follow = async () => {
  if (!document.hidden) await refresh().catch(() => { state.textContent = "nearlift serve does not answer."; });
  setTimeout(follow, PERIOD_MS);
};
setTimeout(follow, PERIOD_MS);
