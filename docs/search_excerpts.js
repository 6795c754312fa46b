// Under each result of a search, what its page says about the word, with the word marked.

const BEFORE = 60, AFTER = 140; // letters of an excerpt before and after the word

function excerpt(text, words) {
  const lower = text.toLowerCase();
  const at = words.map((word) => lower.indexOf(word)).filter((place) => place >= 0).sort((a, b) => a - b)[0];
  if (at === undefined) return null;
  const [from, to] = [Math.max(0, at - BEFORE), Math.min(text.length, at + AFTER)];
  const begin = from ? text.indexOf(" ", from) + 1 : 0; // whole words
  const found = document.createElement("p");
  found.className = "context";
  found.append(begin ? "… " : "");
  let next = begin;
  const marked = new RegExp(words.map((word) => word.replace(/[.*+?^${}()|[\]\\]/g, "\\$&")).join("|"), "gi");
  for (const hit of text.slice(begin, to).matchAll(marked)) {
    const mark = document.createElement("mark");
    mark.textContent = hit[0];
    found.append(text.slice(next, begin + hit.index), mark);
    next = begin + hit.index + hit[0].length;
  }
  found.append(text.slice(next, to), to < text.length ? " …" : "");
  return found;
}

function explain(item, words) {
  const link = item.querySelector("a");
  if (!link || item.querySelector(".context")) return;
  const name = new URL(link.href).pathname.split("/").pop().replace(/\.html$/, "");
  const found = excerpt(window.pageTexts[name] ?? "", words);
  if (found) item.append(found);
}

const words = (new URLSearchParams(location.search).get("q") ?? "").toLowerCase().split(/\s+/).filter(Boolean);
const texts = document.createElement("script");
texts.src = "_static/page_texts.js";
texts.addEventListener("load", () => {
  const results = document.getElementById("search-results");
  const all = () => results.querySelectorAll("ul.search > li").forEach((item) => explain(item, words));
  new MutationObserver(all).observe(results, { childList: true, subtree: true });
  all();
});
if (words.length) document.head.append(texts);
