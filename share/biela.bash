# completion of biela's command line for bash
_biela() {
  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]}
  case $before in
    --output|-o) COMPREPLY=($(compgen -d -- "$word")); return ;;
    --set) compopt -o nospace 2>/dev/null   # the parameters of decks that stand on the line already
      COMPREPLY=($(compgen -S = -W "$(grep -his '^ *&parameter ' -- "${COMP_WORDS[@]:1}" |
        sed -n "s/.*name *= *['\"]\([A-Za-z][A-Za-z0-9_]*\)['\"].*/\1/p")" -- "$word")); return ;;
    --jobs|-j) COMPREPLY=($(compgen -W "1 2 4 8 16 $(nproc 2>/dev/null)" -- "$word")); return ;;
  esac
  if [[ $word == -* ]]; then
    COMPREPLY=($(compgen -W "--check --flat --json --jobs --output --restart --set --quiet --version --help" -- "$word"))
  else
    compopt -o filenames 2>/dev/null
    COMPREPLY=($(compgen -f -X '!*.nml' -- "$word") $(compgen -d -- "$word"))
  fi
}
complete -F _biela biela
