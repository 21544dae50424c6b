// In place of furo's script (conf.py): Debian's is a module, which no browser loads from a folder, and its style has no rule for "auto".
document.documentElement.classList.remove("no-js"); // the theme's button is there
const kept = (value) => {
  try {
    if (value) localStorage.setItem("theme", value);
    return localStorage.getItem("theme");
  } catch {
    return value; // a page from a folder may have no storage
  }
};
const system = matchMedia("(prefers-color-scheme: dark)");
const show = (theme) => (document.body.dataset.theme = /^(light|dark)$/.test(theme) ? theme : system.matches ? "dark" : "light");
show(kept());
system.addEventListener("change", () => show(kept()));
for (const button of document.querySelectorAll(".theme-toggle"))
  button.addEventListener("click", () => show(kept(document.body.dataset.theme === "dark" ? "light" : "dark")));

// What the theme leaves to guess for who does not see the page, and what keys could not move.
document.querySelector(".sidebar-drawer")?.setAttribute("aria-label", "Pages");
document.querySelector(".toc-drawer")?.setAttribute("aria-label", "On this page");
for (const overlay of document.querySelectorAll(".overlay")) overlay.setAttribute("aria-hidden", "true");
const reachable = () => {
  for (const block of document.querySelectorAll("pre, table.docutils, .table-wrapper, .math-wrapper"))
    if (block.scrollWidth > block.clientWidth) block.tabIndex = 0;
};
reachable();
// An equation says its TeX to who does not see it.
addEventListener("load", () =>
  window.MathJax?.Hub?.Queue(() => {
    for (const equation of MathJax.Hub.getAllJax())
      document.querySelector(`#${equation.inputID}-Frame svg`)?.setAttribute("aria-label", equation.originalText);
    reachable();
  }),
);

for (const block of document.querySelectorAll("div.highlight")) {
  const button = Object.assign(document.createElement("button"), { className: "copy", type: "button", textContent: "copy" });
  button.addEventListener("click", async () => {
    const text = block.querySelector("pre").innerText.replace(/\n$/, "");
    try {
      await navigator.clipboard.writeText(text);
    } catch {
      getSelection().selectAllChildren(block.querySelector("pre")); // the reader's own key copies it
      return;
    }
    button.textContent = "copied";
    setTimeout(() => (button.textContent = "copy"), 1500);
  });
  block.append(button);
}
