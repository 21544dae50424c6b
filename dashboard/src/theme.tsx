/** Light, dark, or as the system says. */
import { useCallback, useEffect, useState } from "preact/hooks";

export type Choice = "system" | "light" | "dark";
const order: Choice[] = ["system", "light", "dark"];
const place = "knothe-colours";

function stored(): Choice {
  try {
    return order.find((c) => c === localStorage.getItem(place)) ?? "system";
  } catch {
    return "system";
  }
}

export function useTheme(): [Choice, boolean, () => void] {
  const [choice, setChoice] = useState<Choice>(stored);
  const query = matchMedia("(prefers-color-scheme: dark)");
  const [system, setSystem] = useState(query.matches);
  useEffect(() => {
    const listen = (e: MediaQueryListEvent): void => setSystem(e.matches);
    query.addEventListener("change", listen);
    return () => query.removeEventListener("change", listen);
  }, []);
  const dark = choice === "system" ? system : choice === "dark";
  useEffect(() => {
    document.documentElement.dataset.colours = dark ? "dark" : "light";
    try {
      localStorage.setItem(place, choice);
    } catch {
      // Not kept where the browser has no storage.
    }
  }, [choice, dark]);
  const next = useCallback(() => setChoice((c) => order[(order.indexOf(c) + 1) % order.length]!), []);
  return [choice, dark, next];
}

/** Which colours are shown; a click takes the next of system, dark, light. */
export function ThemeButton({ choice, next }: { choice: string; next: () => void }) {
  return (
    <button type="button" onClick={next}>
      <span class="hidden">Colours: </span>
      {choice === "system" ? "◐ as system" : choice === "dark" ? "● dark" : "○ light"}
    </button>
  );
}
