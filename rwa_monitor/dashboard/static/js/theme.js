/** Light or dark: as the system has it, or as was chosen with the switch; light on paper. No module, so that it is set
 *  before the page is first drawn. Whoever draws on a canvas listens for "themechange". */
{
  const CHOICES = ["system", "light", "dark"];
  const ITEM = "rwa-monitor theme";
  const dark = matchMedia("(prefers-color-scheme: dark)");
  let choice = "system", paper = false;
  try {
    choice = CHOICES.find((one) => one === localStorage.getItem(ITEM)) ?? choice;
  } catch { /* a browser may refuse to keep anything */ }

  function show() {
    document.documentElement.dataset.theme = paper ? "light" : choice !== "system" ? choice : dark.matches ? "dark" : "light";
    const button = document.getElementById("theme");
    if (button) button.textContent = `Theme: ${choice}`;
    dispatchEvent(new Event("themechange"));
  }

  function next() {
    choice = CHOICES[(CHOICES.indexOf(choice) + 1) % CHOICES.length];
    try {
      localStorage.setItem(ITEM, choice);
    } catch { /* it holds until the page is closed */ }
    show();
  }

  dark.addEventListener("change", show);
  addEventListener("beforeprint", () => { paper = true; show(); });
  addEventListener("afterprint", () => { paper = false; show(); });
  addEventListener("DOMContentLoaded", () => {
    document.getElementById("theme").addEventListener("click", next);
    show();
  });
  show();
}
