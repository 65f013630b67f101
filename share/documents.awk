# Puts what the table of keys says into a document (src/deck/keys.awk reads the table): input/README.md, between `<!-- keys of
# &group -->` and `<!-- -->`; biela.1, between .\" keys and .\" end of keys; completions, between `# keys` and `# end of keys`.
NR == FNR { next }
/^<!-- keys of &/ { print; print_table(substr($0, 15, length($0) - 18)); inside = 1; next }
/^[.]\\" keys/ { print; for (g = 1; g <= groups; g++) print_manual(g); inside = 1; next }
/^ *# keys/ { print; print_words(); inside = 1; next }
/^<!-- -->|end of keys/ { inside = 0 }
!inside

# --- a table of the reference; the keys of a marker are one row
function print_table(wanted,   g, k, units, ranges, kinds_) {
  for (g = 1; group[g] != wanted; g++) if (g > groups) { print "no group " wanted | "cat 1>&2"; exit 1 }
  for (k = first_row[g]; k <= last_row[g]; k++) {
    if (unit[k] != "" && target[k] !~ /%(share|point)/) units = 1
    if (range[k] != "") ranges = 1
    if (kinds[k] != "" && type[k] !~ /^&body/) kinds_ = 1
  }
  print "| key |" (units ? " unit |" : "") (ranges ? " range, words |" : "") (kinds_ ? " only for |" : "") " meaning |"
  print "| --- |" (units ? " --- |" : "") (ranges ? " --- |" : "") (kinds_ ? " --- |" : "") " --- |"
  for (k = first_row[g]; k <= last_row[g]; k++) if (target[k] !~ /%(node|share|point)/)
    print "| " key_cell(k) " |" (units ? cell(unit[k]) : "") (ranges ? cell(range_cell(k)) : "") (kinds_ ? cell(kinds_cell(k)) : "") \
      cell(k in whole ? whole[k] : meaning[k])
}
function cell(text) { return (text == "" ? "" : " " text) " |" }
function key_cell(k,   text, j) {
  if (preset[k] == "" && k in whole) {
    text = required[k] ? "**`" name[k] "`**" : "`" name[k] "`"
    for (j = k + 1; target[j] ~ /%(node|share|point)/ && of[j] == of[k]; j++) text = text ", `" name[j] "`"
    return text
  }
  text = preset[k] ~ /^[-0-9.]/ && type[k] !~ /word|choice/ ? preset[k] : type[k] ~ /word|choice/ && preset[k] != "" ? "'" preset[k] "'" : preset[k]
  text = "`" name[k] (text == "" ? "" : "=" text) "`"
  return required[k] ? "**" text "**" : text
}
function range_cell(k,   n, part, text, j) {
  n = split(range[k], part, " ")
  if (type[k] !~ /word|choice|letter/) return n == 4 ? part[1] " " part[2] ", " part[3] " " part[4] : range[k]
  for (j = 1; j <= n; j++) text = text (j > 1 ? ", " : "") "`'" part[j] "'`"
  return text
}
function kinds_cell(k,   text, word) {      # many: the table of quantities has them
  text = split(kinds[k], word, " ") > 4 ? "see below" : kinds[k]; gsub(/ /, ", ", text); return text
}

# --- a paragraph of the manual page
function print_manual(g,   k, text, words, seen) {
  text = plain(about[g]) ":"
  for (k = first_row[g]; k <= last_row[g]; k++) {
    if (name[k] in seen) continue
    seen[name[k]]; words = range[k]; gsub(/ /, ", ", words); gsub(/-/, "\\-", words)
    text = text " \\fB" name[k] "\\fR" (type[k] ~ /word|choice/ ? " (" words ")" : "") ","
  }
  sub(/,$/, ".", text)
  print ".TP\n.B &" group[g]
  fold(text)
}
function plain(text) { gsub(/`/, "", text); return text }
function fold(text,   n) {
  while (length(text) > 118) {
    for (n = 118; substr(text, n, 1) != " "; n--);
    print substr(text, 1, n - 1)
    text = substr(text, n + 1)
  }
  print text
}

# --- groups and keys, once each, in the order of the table
function print_words(   g, k, seen, text) {
  for (g = 1; g <= groups; g++) {
    if (!(group[g] in seen)) text = text " " group[g]
    seen[group[g]]
    for (k = first_row[g]; k <= last_row[g]; k++) { if (!(name[k] in seen)) text = text " " name[k]; seen[name[k]] }
  }
  print "  local words=\"\\"
  fold(substr(text, 2) "\"")
}
