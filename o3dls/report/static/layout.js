// What is open on wide screens and folded on narrow ones, and which section is in sight.
{
  const wide = matchMedia("(min-width: 1100px), print"); // as in layout.css
  const fold = () => document.querySelectorAll("details.folds").forEach((one) => { one.open = wide.matches; });
  wide.addEventListener("change", fold);
  fold();

  const contents = document.querySelector("nav.contents");
  const links = new Map([...document.querySelectorAll("nav.contents a")].map((link) => [link.hash.slice(1), link]));
  const sections = [...links.keys()].map((id) => document.getElementById(id));
  const inSight = new Set();
  let atEnd = false;

  const mark = () => {
    const current = atEnd ? sections.at(-1) : sections.find((one) => inSight.has(one));
    if (!current) return; // between two sections the mark stays
    links.forEach((link, id) => {
      if (id === current.id) link.setAttribute("aria-current", "location");
      else link.removeAttribute("aria-current");
    });
    document.getElementById("section-in-sight").textContent = links.get(current.id).textContent;
  };

  if (contents) {
    const look = new IntersectionObserver((entries) => {
      entries.forEach(({ target, isIntersecting }) => (isIntersecting ? inSight.add(target) : inSight.delete(target)));
      mark();
    }, { rootMargin: "-15% 0px -60% 0px" }); // the part of the window in which one reads
    sections.forEach((one) => look.observe(one));
    // the last sections may be too short to get there
    new IntersectionObserver(([{ isIntersecting }]) => { atEnd = isIntersecting; mark(); }).observe(document.querySelector("footer"));
    contents.addEventListener("click", ({ target }) => {
      if (target.closest("a") && !wide.matches) contents.querySelector("details").open = false;
    });
  }
}
