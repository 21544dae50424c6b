/** A part of the page: title, what it means, what can be taken away. */
import type { ComponentChildren } from "preact";
import { save, saveText } from "./png";

interface Props {
  id: string;
  title: string;
  note?: string;
  controls?: ComponentChildren;
  png?: (() => Promise<Blob>) | undefined;
  csv?: (() => string | undefined) | undefined;
  children: ComponentChildren;
}

export function Panel({ id, title, note, controls, png, csv, children }: Props) {
  const table = (): void => {
    const text = csv?.();
    if (text) saveText(text, `knothe-${id}.csv`);
  };
  return (
    <section id={id} class="panel" aria-labelledby={`${id}-title`} tabIndex={-1}>
      <header>
        <h2 id={`${id}-title`}>{title}</h2>
        <span class="controls">
          {controls}
          {png && (
            <button
              type="button"
              aria-label={`${title}: save as PNG`}
              onClick={() => void png().then((blob) => save(blob, `knothe-${id}.png`))}
            >
              PNG
            </button>
          )}
          {csv && (
            <button type="button" aria-label={`${title}: save as CSV`} onClick={table}>
              CSV
            </button>
          )}
        </span>
      </header>
      {note && <p class="note">{note}</p>}
      {children}
    </section>
  );
}
