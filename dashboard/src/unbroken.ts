/** No line ends between a number and its unit, in any text of a page. */
import { options, type ComponentChild, type VNode } from "preact";

const beforeUnit = /(?<=[\d⁰¹²³⁴⁵⁶⁷⁸⁹]) (?=(?:%|σ|px|nats|[GMkmµn]?(?:m|N|Pa|J|s|Hz|V|W))(?![A-Za-z]))/g;
const beforeSpread = /(?<=\d) (?=±)/g;
const behindSign = /(?<=[<>=±×]) (?=[−\d])/g;

export function unbroken(text: string): string {
  return text.replace(beforeUnit, "\u00a0").replace(beforeSpread, "\u00a0").replace(behindSign, "\u00a0");
}

/** In what is written already, and in all that will be rendered. */
export function bindUnits(written: Node): void {
  const texts = document.createTreeWalker(written, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const node = texts.currentNode as Text;
    if (node.parentElement?.closest("pre, script") === null) node.data = unbroken(node.data);
  }
  const bind = (child: ComponentChild): ComponentChild => (typeof child === "string" ? unbroken(child) : child);
  options.vnode = ({ type, props }: VNode<{ children?: ComponentChild | ComponentChild[] }>): void => {
    if (typeof type !== "string" || props.children === undefined) return;
    props.children = Array.isArray(props.children) ? props.children.map(bind) : bind(props.children);
  };
}
