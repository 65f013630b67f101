# Makes a Fortran module from the table of keys. -v make=deck_keys: the table as data; deck_values: records; deck_take: what reads
# a group into its record.
END {
  declared["real"] = declared["pair"] = "real(wp)"; declared["integer"] = declared["auto"] = declared["&"] = "integer"
  declared["logical"] = "logical"; declared["word"] = declared["choice"] = "character(longest_word)"
  declared["letter"] = "character(1)"; declared["text"] = "character(:), allocatable"; declared["column"] = "type(column_record)"
  reader["real"] = reader["integer"] = reader["logical"] = reader["text"] = "get"; reader["pair"] = "get_pair"
  reader["auto"] = "get_auto"; reader["word"] = reader["choice"] = "get_word"; reader["name"] = "get_name"; reader["&"] = "get_reference"
  reader["column"] = "get_column"; reader["input"] = "get_input"; reader["real..."] = reader["integer..."] = "get_list"
  reader["letter..."] = "get_letters"; reader["&..."] = "get_references"
  for (k = 1; k <= rows; k++) { plain[k] = type[k]; sub(/&[a-z]*/, "\\&", plain[k]) }
  if (make == "deck_keys") print_keys(); else if (make == "deck_values") print_values(); else print_take()
}

# --- the table as data
function print_keys(   k, in_, names, meanings, single, is_named) {
  head("deck_keys", "  use kinds, only: wp\n  use deck_key, only: key\n")
  print "  integer, parameter, public :: group_kinds = " groups
  for (k = 1; k <= groups; k++) {
    in_ = record[k]; sub(/_.*/, "", in_)
    print "  integer, parameter, public :: in_" in_ " = " k
    names[k] = text(group[k]); meanings[k] = text(about[k])
    single[k] = truth(property[k] == "single"); is_named[k] = truth(property[k] == "named")
  }
  list("group_names", "character(18)", names); list("group_meanings", "character(80)", meanings)
  list("first_key", "integer", first_row); list("last_key", "integer", last_row)
  list("is_single", "logical", single); list("is_named", "logical", is_named)
  print "  type(key), protected, save, public :: keys(" rows ")"
  for (k = 1; k <= rows; k++) out("  data keys(" k ") /" constant(k) "/")
  print "end module deck_keys"
}
function list(name, type, items,   k, line) {
  for (k = 1; k <= groups; k++) line = line (k > 1 ? ", " : "") items[k]
  out("  " type ", parameter, public :: " name "(group_kinds) = [" (type ~ /^char/ ? type " :: " : "") line "]")
}
function constant(k,   low, high, words, n, part, mask, j) {
  low = "-huge"; high = "huge"; words = plain[k] ~ /^&/ ? type[k] : range[k]
  if (plain[k] ~ /real|pair|integer|auto/) {
    n = split(range[k], part, " "); words = ""
    if (part[2] == "to") { low = part[1]; high = part[3] } else if (n > 0) low = part[2]
    if (n == 4) high = part[4]
  }
  gsub(/&|[.]/, "", words)
  n = split(kinds[k], part, " ")
  for (j = 1; j <= n; j++) mask += 2 ^ place(part[j], range[choice[of[k]]])
  return "key(" text(name[k]) ", " text(type[k]) ", " text(unit[k]) ", " text(preset[k]) ", " truth(required[k]) ", " real(low) ", " \
    real(high) ", " truth(range[k] ~ /^> /) ", " text(words) ", " mask + 0 ", " text(meaning[k]) ", " text(instead[k]) ", " \
    text(rules[k]) ")"
}
function place(wanted, words,   n, k, part) {      # from 0
  n = split(words, part, " ")
  for (k = 1; k <= n; k++) if (part[k] == wanted) return k - 1
  print "keys.txt: only for " wanted ", which is no word of the group's choice" | "cat 1>&2"
  exit 1
}

# --- records
function print_values(   g, k, known) {
  head("deck_values", "  use kinds, only: wp\n  use deck_key, only: longest_word\n  use deck_origin, only: named_record, origin\n" \
    "  use deck_parts, only: column_record, law_record, marker_record\n")
  for (g = 2; g <= groups; g++) {
    print "\n  !> &" group[g] ": " about[g] "\n  type" (property[g] == "named" ? ", extends(named_record)" : "") ", public :: " record[g]
    if (property[g] != "named") print "    type(origin) :: at"
    if (property[g] == "single") print "    logical :: present = .false."
    split("", known)
    for (k = first_row[g]; k <= last_row[g]; k++) component(k, target[k], plain[k], initial[k], known)
    print "  end type " record[g]
  }
  print "end module deck_values"
}
function component(k, target, plain, initial, known,   part) {
  if (target ~ /%/) { sub(/%.*/, "", target); plain = "part" }
  if (target in known || plain == "name") return
  known[target]
  if (plain == "part") print "    type(" (target == "law" ? target : "marker") "_record) :: " target
  else if (plain == "input") print "    integer :: force = 0, drive = 0"
  else if (plain ~ /[.]+$/) { sub(/[.]+$/, "", plain); print "    " declared[plain] ", allocatable :: " target "(:)" }
  else if (plain ~ /column|text/) print "    " declared[plain] " :: " target
  else {
    if (plain == "pair") { split(initial, part, ","); target = target "(2)"; initial = "[" real(part[1]) ", " real(part[2]) "]" }
    if (plain == "real") initial = real(initial)
    if (plain ~ /word|choice/) initial = text(initial)
    print "    " declared[plain] " :: " target " = " (initial == "" ? 0 : initial)
    if (plain == "auto") print "    logical :: auto_" target " = .false."
  }
}

# --- what reads a group
function print_take(   g, k) {
  head("deck_take", "  use deck_get, only: get, get_auto, get_list, get_pair\n  use deck_input, only: deck_source\n  use deck_keys\n" \
    "  use deck_values\n  use deck_words, only: get_column, get_input, get_letters, get_name, get_reference, get_references, get_word\n" \
    "  use deck_rules, only: check_rules\n")
  print "  public :: take\n\n  !> Reads every key of the open group into its record.\n  interface take"
  for (g = 2; g <= groups; g++) print "    module procedure :: take_" group[g]
  print "  end interface take\n\ncontains"
  for (g = 2; g <= groups; g++) {
    print "\n  subroutine take_" group[g] "(deck, r)\n    class(deck_source), intent(inout) :: deck\n    class(" record[g] "), intent(inout) :: r"
    print "    r%at = deck%at()" (property[g] == "single" ? "\n    r%present = .true." : "")
    for (k = first_row[g]; k <= last_row[g]; k++) print "    call " reader[plain[k]] "(deck, " k ", " arguments(k, "r%" target[k]) ")"
    print "    call check_rules(deck, " first_row[g] ", " last_row[g] ")\n  end subroutine take_" group[g]
  }
  print "end module deck_take"
}
function arguments(k, target,   kind) {
  kind = type[k]; gsub(/&|[.]/, "", kind)
  if (plain[k] == "input") return "r%force, r%drive"
  if (plain[k] == "column") return target "%sensor, " target "%suffix"
  if (plain[k] == "auto") return target ", r%auto_" substr(target, 3)
  return target (plain[k] ~ /^&/ ? ", in_" kind : "")
}

# --- Fortran
function real(x) { return x ~ /huge/ ? x "(1.0_wp)" : (x == "" ? "0.0" : x ~ /[.e]/ ? x : x ".0") "_wp" }
function truth(yes) { return yes ? ".true." : ".false." }
function text(s) { gsub(/'/, "''", s); gsub(/`/, "", s); return "'" s "'" }
function head(module, uses) {
  print "!> Made from keys.txt by keys_fortran.awk.\nmodule " module "\n" uses "  implicit none (type, external)\n  private"
}
function out(line,   n) {        # in lines of no more than 120 characters
  while (length(line) > 120) {
    for (n = 120; substr(line, n, 1) != " "; n--);
    print substr(line, 1, n) "&"
    line = "&" substr(line, n + 1)
  }
  print line
}
