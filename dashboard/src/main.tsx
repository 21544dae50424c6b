import { render } from "preact";
import { App } from "./app";
import { Store } from "./store";
import { bindUnits } from "./unbroken";

bindUnits(document.body);
const store = new Store();
render(<App store={store} />, document.getElementById("page")!);
store.start();
