"""Which sources of a target are compiled together (cmake/KnotheUnity.cmake).

Usage: unity_groups.py SIZE SOURCE…; prints the number of a group for each source, in order. A group has at most SIZE
sources, and no two of a group define the same name in their anonymous namespaces, so nobody has to choose names with
other files in mind; what replaces the program's allocation stays alone. What this reading of C++ overlooks is as a rule an
error of the compiler.
"""

import re
import sys


def without_texts(source):
    source = re.sub(r'R"(\w*)\((.*?)\)\1"', '""', source, flags=re.S)
    source = re.sub(r"//[^\n]*|/\*.*?\*/", "", source, flags=re.S)
    return re.sub(r'"(\\.|[^"\\\n])*"|\'(\\.|[^\'\\\n])\'', '""', source)


def declarations(source):
    """What stands before each `{` and `;` at the outer level of the anonymous namespaces."""
    for opening in re.finditer(r"\bnamespace\s*\{", source):
        depth, text = 1, ""
        for character in source[opening.end():]:
            if depth == 1 and character in "{;":
                yield " ".join(text.split())
                text = ""
            elif depth == 1 and character != "}":
                text += character
            depth += (character == "{") - (character == "}")
            if depth == 0:
                break


def defined_names(path):
    with open(path, encoding="utf-8") as file:
        source = without_texts(file.read())
    if re.search(r"^void\* operator new\(", source, re.M):
        return None
    names = dict.fromkeys(re.findall(r"^#define (\w+)", source, re.M))
    names.update(re.findall(r"^using (\w+) = ([^;]+);", source, re.M))  # twice the same alias is no error
    for text in declarations(source):
        if re.match(r"(using|static_assert|friend|(TYPED_)?TEST\w*|INSTANTIATE\w+)\b", text):
            continue
        text = re.sub(r"^template\s*<.*?>\s*(?=\w)", "", text)
        kind = re.match(r"(?:struct|class|enum class|enum|union)\s+(\w+)", text)
        function = re.search(r"(\w+)\s*\(", text)
        if kind and not function:
            names[kind[1]] = None
        elif function and "=" not in text[:function.start()]:
            names[function[1]] = None
        else:
            for variable in text.split("=")[0].split(","):
                name = re.search(r"(\w+)\s*(\[.*\])?$", variable.strip())
                if name:
                    names[name[1]] = None
            # constexpr Index k_rows = 4, k_columns = 5;
            names.update(dict.fromkeys(re.findall(r",\s*(k_\w+)\s*=", text)))
    return names


def agree(names, others):
    return all(names[name] is not None and names[name] == others[name] for name in names.keys() & others.keys())


def main():
    size, sources = int(sys.argv[1]), sys.argv[2:]
    groups = []  # [how many, what they define]
    chosen = []
    for source in sources:
        names = defined_names(source)
        if names is None:
            chosen.append(len(groups))
            groups.append([size, {}])
            continue
        for number, group in enumerate(groups):
            if group[0] < size and agree(names, group[1]):
                break
        else:
            number, group = len(groups), [0, {}]
            groups.append(group)
        group[0] += 1
        group[1].update(names)
        chosen.append(number)
    print(";".join(map(str, chosen)), end="")


main()
