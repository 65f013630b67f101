#!/bin/sh
# Installs what biela needs and this machine lacks, each part once; make calls it. What is there already is left alone.
#   ./setup.sh check       installs nothing, tells what to type where the compiler or a library is missing
#   ./setup.sh toolchain   a Fortran compiler, LAPACK and BLAS, by the distribution's own package manager
#   ./setup.sh python      .venv with the packages of requirements.txt
# FC, LDLIBS and PYTHON (see the Makefile) name other compilers, libraries and interpreters.
set -u
cd "$(dirname "$0")" || exit 1
fc=${FC:-gfortran}
libraries=${LDLIBS:--llapack -lblas}
python=${PYTHON:-python3}
no_fortran="gfortran, LAPACK or BLAS is missing"
no_python="Python 3.9 or newer with the module venv"

say() { echo "setup: $*"; }
fail() { echo "setup: $*" >&2; exit 1; }

# Does a program compile, link with LAPACK and BLAS, and run?
fortran_works() {
  command -v "$fc" >/dev/null 2>&1 || return 1
  folder=$(mktemp -d 2>/dev/null || mktemp -d ./.try.XXXXXX) || fail "no folder for temporary files can be made"
  cat > "$folder/try.f90" <<'END'
program try
  implicit none
  double precision :: a(1, 1) = 4.0d0, x(1) = 1.0d0
  double precision, external :: ddot
  integer :: info
  external :: dpotrf
  call dpotrf('L', 1, a, 1, info)
  if (info /= 0 .or. abs(ddot(1, a, 1, x, 1) - 2.0d0) > 1.0d-12) stop 1
end program try
END
  # shellcheck disable=SC2086
  "$fc" "$folder/try.f90" -o "$folder/try" $libraries >/dev/null 2>&1 && "$folder/try"
  result=$?
  rm -rf "$folder"
  return $result
}

python_works() {
  command -v "$python" >/dev/null 2>&1 && "$python" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 9))' 2>/dev/null
}

# install_line WHAT...: the command that installs the compiler and libraries, Python, or both, on this distribution.
install_line() {
  for manager in apt-get dnf pacman zypper apk none; do
    command -v $manager >/dev/null 2>&1 && break
  done
  packages=
  for what in "$@"; do
    case $manager/$what in
      apt-get/toolchain) packages="$packages gfortran libc6-dev liblapack-dev libblas-dev make" ;;
      apt-get/python) packages="$packages python3 python3-venv" ;;
      dnf/toolchain) packages="$packages gcc-gfortran lapack-devel blas-devel make" ;;
      pacman/toolchain) packages="$packages gcc-fortran lapack blas make" ;;
      pacman/python) packages="$packages python" ;;
      zypper/toolchain) packages="$packages gcc-fortran lapack-devel blas-devel make" ;;
      apk/toolchain) packages="$packages gfortran musl-dev lapack-dev blas-dev make" ;;
      */python) packages="$packages python3" ;;
    esac
  done
  case $manager in
    apt-get) echo "apt-get update; DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends -o DPkg::Lock::Timeout=300$packages" ;;
    dnf) echo "dnf install -y$packages" ;;
    pacman) echo "pacman -Sy --needed --noconfirm$packages" ;;
    zypper) echo "zypper --non-interactive install$packages" ;;
    apk) echo "apk add$packages" ;;
  esac
}

# install WHAT REASON: as root, or with sudo; elsewhere the line to type, which then installs all that is missing.
install() {
  line=$(install_line "$1")
  [ -n "$line" ] || fail "$2, and no package manager that this script knows was found: please install it by hand"
  if [ "$(id -u)" -eq 0 ]; then
    say "$2: installing it with: $line"
    sh -c "$line" >&2
  elif command -v sudo >/dev/null 2>&1 && { [ -t 0 ] || sudo -n true 2>/dev/null; }; then
    say "$2: installing it with: sudo sh -c '$line'"
    sudo sh -c "$line" >&2
  elif [ "$1" = toolchain ] && [ "$python" = python3 ] && ! python_works; then
    fail "$2; so is $no_python. As an administrator, please type: $(install_line toolchain python)"
  else
    fail "$2. As an administrator, please type: $line"
  fi
}

# Ends where a compiler that the user has named does not work.
own_compiler_works() {
  [ "$fc" = gfortran ] || fail "FC=$fc does not compile and link a program with $libraries"
}

check() {
  fortran_works && return
  own_compiler_works
  line=$(install_line toolchain)
  fail "$no_fortran; biela is compiled with them. Please type: make setup${line:+, which installs them by: $line}"
}

toolchain() {
  fortran_works && return
  own_compiler_works
  install toolchain "$no_fortran"
  fortran_works || fail "gfortran does not compile and link a program with $libraries"
}

virtual_environment() {
  if ! python_works; then
    [ "$python" = python3 ] || fail "PYTHON=$python is no $no_python"
    install python "$no_python is missing"
    python_works || fail "python3 is still no $no_python"
  fi
  say "Python packages into .venv (once)"
  .venv/bin/python -m pip --version >/dev/null 2>&1 || rm -rf .venv
  "$python" -m venv .venv || fail "$python -m venv .venv failed"
  .venv/bin/python -m pip install --no-input --disable-pip-version-check --prefer-binary --requirement requirements.txt ||
    fail "the packages of requirements.txt could not be installed (is there a network?)"
}

case ${1:-} in
  check) check ;;
  toolchain) toolchain ;;
  python) virtual_environment ;;
  *) fail "usage: ./setup.sh check|toolchain|python" ;;
esac
