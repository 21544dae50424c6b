/** The field on the mesh, with the sensors. */
import { useMemo, useRef, useState } from "preact/hooks";
import { front, oblique, type Camera } from "./camera";
import type { Theme } from "./colour";
import { fieldTable, sensorsTable } from "./csv";
import { quantitiesOf, viewOf } from "./field";
import { FieldCanvas, zoomed } from "./field_canvas";
import { countWords } from "./field_words";
import { boxOf, displayFactor, surfaceOf, type Component } from "./mesh";
import { Panel } from "./panel";
import { throughPicture, usePicture } from "./picture";
import { blobOf } from "./png";
import type { Detail } from "./store";
import type { FieldsAnswer, Model, SensorsAnswer } from "./types";

interface Props {
  model: Model | undefined;
  fields: Detail<FieldsAnswer>;
  sensors: Detail<SensorsAnswer>;
  theme: Theme;
  /** The service has been heard: what it does not have, it will not have. */
  known: boolean;
  quantity: string;
  setQuantity: (quantity: string) => void;
  fetchPicture: (step: number) => Promise<ImageBitmap>;
}

export function FieldPanel({ model, fields, sensors, theme, known, quantity, setQuantity, fetchPicture }: Props) {
  const mesh = model?.mesh;
  const [component, setComponent] = useState<Component>("magnitude");
  const [deformed, setDeformed] = useState(true);
  const [edges, setEdges] = useState(true);
  const [camera, setCamera] = useState<Camera>(front);
  const [readout, setReadout] = useState("");
  const picture = useRef<HTMLCanvasElement>(null);
  const overlay = useRef<HTMLCanvasElement>(null);
  const ground = useRef<HTMLCanvasElement>(null);
  const [behind, setBehind] = useState(true);
  const image = usePicture(behind && model?.picture ? fields.value?.step : undefined, fetchPicture);

  const geometry = useMemo(() => mesh && { mesh, surface: surfaceOf(mesh), box: boxOf(mesh.points) }, [mesh]);
  const shown = useMemo(
    () => viewOf(quantity, component, fields.value, sensors.value, model?.sensors?.std ?? []),
    [quantity, component, fields.value, sensors.value, model],
  );
  // A picture shows the structure as it is: then so does the mesh.
  const larger = fields.value && geometry ? displayFactor(fields.value.displacement, geometry.box) : 0;
  const factor = !deformed ? 0 : image ? Math.min(1, larger) : larger;
  const counts = countWords(sensors.value);
  const step = quantity === "residual" ? sensors.value?.step : fields.value?.step;
  const title = `Field on the structure${step === undefined ? "" : `, step ${step}`}`;
  const none = known ? "The model of this site has no mesh." : "";
  const problem = mesh ? (fields.problem ?? shown.problem) : none;
  const table = (): string | undefined => {
    if (shown.sensors) return sensors.value && model?.sensors && sensorsTable(sensors.value, model.sensors);
    const values = vectorsOf(quantity, fields.value);
    return values && mesh && fieldTable(quantity.replace(":", "_"), values, mesh);
  };
  const choices = (
    <>
      <Choice
        label="Field"
        value={quantity}
        options={quantitiesOf(model?.parameters.map((p) => p.name) ?? [])}
        choose={setQuantity}
      />
      {!shown.sensors && (
        <Choice label="Component" value={component} options={components} choose={(c) => setComponent(c as Component)} />
      )}
    </>
  );
  return (
    <Panel
      id="field"
      title={title}
      png={() => compose([ground.current!, picture.current!, overlay.current!], image !== undefined, theme, title)}
      csv={table}
      controls={choices}
    >
      <FieldCanvas
        {...{
          model,
          geometry,
          shown,
          factor,
          edges,
          camera,
          setCamera,
          theme,
          problem,
          setReadout,
          picture,
          overlay,
          image,
          ground,
        }}
        fields={fields.value}
        sensors={sensors.value}
        label={`${shown.label} on the structure. ${counts}`}
      />
      <div class="under">
        <Check label={`deformed${factor > 1 ? `, ${factor} × larger` : ""}`} checked={deformed} set={setDeformed} />
        <Check label="elements" checked={edges} set={setEdges} />
        {model?.picture && <Check label="picture" checked={behind} set={setBehind} />}
        <CameraButtons setCamera={setCamera} />
        <span class="readout">{readout || counts}</span>
      </div>
    </Panel>
  );
}

const components = ["magnitude", "x", "y", "z"].map((c) => ({ value: c, label: c }));

interface ChoiceProps {
  label: string;
  value: string;
  options: { value: string; label: string }[];
  choose: (value: string) => void;
}

function Choice({ label, value, options, choose }: ChoiceProps) {
  return (
    <select aria-label={label} value={value} onChange={(e) => choose(e.currentTarget.value)}>
      {options.map((o) => (
        <option key={o.value} value={o.value}>
          {o.label}
        </option>
      ))}
    </select>
  );
}

function Check({ label, checked, set }: { label: string; checked: boolean; set: (checked: boolean) => void }) {
  return (
    <label>
      <input type="checkbox" checked={checked} onChange={(e) => set(e.currentTarget.checked)} /> {label}
    </label>
  );
}

function CameraButtons({ setCamera }: { setCamera: (change: (camera: Camera) => Camera) => void }) {
  return (
    <span class="buttons">
      <button type="button" aria-label="Larger" title="Larger" onClick={() => setCamera((c) => zoomed(c, 1.25))}>
        +
      </button>
      <button type="button" aria-label="Smaller" title="Smaller" onClick={() => setCamera((c) => zoomed(c, 0.8))}>
        −
      </button>
      <button type="button" onClick={() => setCamera(() => front)}>
        front
      </button>
      <button type="button" onClick={() => setCamera(() => oblique)}>
        oblique
      </button>
    </span>
  );
}

function vectorsOf(quantity: string, fields: FieldsAnswer | undefined): number[][] | undefined {
  if (quantity === "displacement") return fields?.displacement;
  return quantity === "bias" ? fields?.bias : fields?.sensitivity[quantity.split(":")[1] ?? ""];
}

function compose(layers: HTMLCanvasElement[], through: boolean, theme: Theme, title: string): Promise<Blob> {
  const [ground, picture, overlay] = layers as [HTMLCanvasElement, HTMLCanvasElement, HTMLCanvasElement];
  const canvas = document.createElement("canvas");
  const top = 34 * devicePixelRatio;
  canvas.width = picture.width;
  canvas.height = picture.height + top;
  const ctx = canvas.getContext("2d")!;
  ctx.fillStyle = theme.panel;
  ctx.fillRect(0, 0, canvas.width, canvas.height);
  ctx.fillStyle = theme.text;
  ctx.font = `600 ${14 * devicePixelRatio}px system-ui, sans-serif`;
  ctx.fillText(title, 10 * devicePixelRatio, 22 * devicePixelRatio);
  ctx.drawImage(ground, 0, top);
  ctx.globalAlpha = through ? throughPicture : 1;
  ctx.drawImage(picture, 0, top);
  ctx.globalAlpha = 1;
  ctx.drawImage(overlay, 0, top);
  return blobOf(canvas);
}
