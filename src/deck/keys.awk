# Reads keys.txt into arrays; what is made of them follows in another program: keys_fortran.awk, share/documents.awk.
# Groups: group, record, property, about, first_row, last_row. Rows: name, target, type, unit, default, range, kinds, meaning,
# instead, rules, of (the group's number), whole (the marker's keys as one row: on the first of them).
BEGIN { FS = " *[|] *" }
NR == FNR && /^&/ {
  group[++groups] = substr($1, 2); record[groups] = $2; property[groups] = $3; about[groups] = $4; first_row[groups] = rows + 1
}
NR == FNR && /^let/ { named[$2] = $3 }
NR == FNR && /^marker/ { split($1, word, " "); marker(word[2], $2, $3, expand($4), expand($5), $6 == "-" ? "-" : expand($6)) }
NR == FNR && !/^ *(#|$)/ && !/^(&|let|marker)/ { row($1, $2, $3, $4, $5, expand($6), $7, $8, $9) }

# the words of a list, those of a named list in the place of its name
function expand(list,   n, k, part, text) {
  n = split(list, part, " ")
  for (k = 1; k <= n; k++) text = text (k > 1 ? " " : "") (part[k] in named ? named[part[k]] : part[k])
  return text
}

# the keys of a marker: a body, and where on it
function marker(suffix, at, needed, body, node, point,   which) {
  which = "marker" (suffix == "" ? "" : " " substr(suffix, 2))
  row("body" suffix ">" at "%body", "&body", "", needed, "", body, suffix ~ /[bc]/ ? "without it the ground" : "a body or `ground`")
  whole[rows] = (suffix ~ /[bc]/ ? which "; without it the ground" : which)
  row("node" suffix ">" at "%node", "integer", "", "(0)", "", node, which ", on a beam or frame: 1 is the first node, -1 the last")
  row("at" suffix ">" at "%share", "real", "-", "(-1)", "0 to 1", node, "in place of `node" suffix "`: where on a beam, of its length", \
    "", "not node" suffix)
  if (point != "-") row("point" suffix ">" at "%point", "pair", "m", "0,0", "", point, \
    which ", on a rigid body or the ground, in body axes")
}

function row(key, kind, in_unit, otherwise, limits, only, sentence, hint, rule) {
  last_row[groups] = ++rows; of[rows] = groups
  target[rows] = name[rows] = key; sub(/>.*/, "", name[rows]); sub(/.*>/, "", target[rows])
  type[rows] = kind; unit[rows] = in_unit; range[rows] = limits; kinds[rows] = only; meaning[rows] = sentence; instead[rows] = hint; rules[rows] = rule
  required[rows] = otherwise == "required"; initial[rows] = required[rows] ? "" : otherwise; gsub(/[()]/, "", initial[rows])
  preset[rows] = otherwise ~ /[(]|required/ ? "" : otherwise
  if (kind == "choice") choice[groups] = rows
}
