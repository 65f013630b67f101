#!/bin/sh
# The suite as other machines run it, as far as this one can stand in for them; `make test-anywhere` calls it.
# TESTS and JOBS as for `make test`; ONLY=word runs what has the word in its name.
set -u
python=$PWD/.venv/bin/python
copies=$(mktemp -d)
failed=
trap 'rm -rf "$copies"' EXIT

suite() { # name, command that the suite follows
  case $1 in *"${ONLY:-}"*) ;; *) return 0 ;; esac
  echo "--- $1"
  name=$1
  shift
  "$@" "$python" -m pytest -q -n "${JOBS:-auto}" ${TESTS:-tests} || failed="$failed, $name"
}
copied() { # folder: the project without what it can do without
  mkdir "$1" && tar -c --exclude=./.git --exclude=./results --exclude=./.venv . | tar -x -C "$1" && ln -s "$(readlink -f .venv)" "$1/.venv"
}
loaded() { # command: beside twenty processes that only count
  busy=
  for _ in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20; do
    sh -c 'while :; do :; done' &
    busy="$busy $!"
  done
  "$@"
  status=$?
  kill $busy
  return $status
}

solver=  # OpenBLAS for the solver, too, which is linked with the reference BLAS
for library in ${OPENBLAS:-/usr/lib/*/openblas-*}; do
  [ -e "$library/liblapack.so.3" ] && solver=LD_LIBRARY_PATH=$library
done
for kernels in Prescott Haswell SkylakeX Zen; do
  suite "BLAS kernels of $kernels" env OPENBLAS_CORETYPE=$kernels ${solver:+"$solver"}
done
suite "locale C" env LC_ALL=C LANG=C
suite "no terminal, no home" env -u TERM -u COLUMNS HOME=/nonexistent
suite "one core" taskset -c 0
suite "a load of twenty" loaded
here=$PWD
copied "$copies/a path with blanks" && cd "$copies/a path with blanks" && suite "a path with blanks" env
cd "$here" || exit 1
if [ "$(id -u)" = 0 ]; then
  chmod 755 "$copies" && copied "$copies/other" && chown -R nobody "$copies/other"
  as_nobody="setpriv --reuid nobody --clear-groups env HOME=/nonexistent"
  if $as_nobody "$python" -c ''; then
    cd "$copies/other" && suite "another user" $as_nobody
  else
    echo "--- another user: left out, since $python belongs to root alone"
  fi
  cd "$here" || exit 1
fi
[ -z "$failed" ] && exit 0
echo "failed: ${failed#, }"
exit 1
