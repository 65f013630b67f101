# biela: build, tests, demonstration. `make help` lists the targets.
#
# Options (make TARGET NAME=value):
#   FC=gfortran       Fortran compiler (gfortran 12 or newer)
#   CC=$(FC)          C compiler of the system calls: gfortran is one, too
#   FFLAGS=-O3        optimisation; floating-point arithmetic stays strict (never -ffast-math)
#   ONCE=-O0          optimisation of what runs once a deck, where -O3 only takes longer to compile; empty: FFLAGS
#   WERROR=-Werror    empty: warnings of another compiler version do not stop the build
#   NATIVE=1          adds -march=native: faster, runs on this kind of processor only
#   DEBUG=1           the checked build (build/debug, bin/*-debug) for any target: make test DEBUG=1
#   BUILD=release     or debug, sanitize (addresses, undefined behaviour), coverage: build/BUILD, bin/*-BUILD
#   LDLIBS="-llapack -lblas"   the linear algebra libraries
#   PYTHON=python3    the Python (3.9 or newer) from which .venv is made
#   TESTS=tests       what `make test` runs: a folder (tests/modes), a file, tests/modes/test_modal.py::test_x
#   JOBS=auto         processes that share the tests
#   PREFIX=/usr/local where `make install` puts the program; DESTDIR=... in front of it, for packages
#   BASE=84ff21ee     the commit beside which `make cost` counts instructions
#   FLANG=flang-new   a second compiler for `make rounding`, left out where it is not there
#   -j N              processes that build; all cores where it is left out

FC      = gfortran
CC      = $(FC)
FFLAGS  = -O3
ONCE    = -O0
WERROR  = -Werror
LDLIBS  = -llapack -lblas
PYTHON  = python3
TESTS   = tests
JOBS    = auto
PREFIX  = /usr/local
FLANG   = flang-new

# gfortran 12 takes the descriptors of allocatable variables for uninitialised: those two warnings are off; the checked
# build (-finit-real=snan with traps) finds the real ones
STANDARD = -std=f2018 -fimplicit-none -Wall -Wextra -Wno-unused-dummy-argument -Wno-uninitialized -Wno-maybe-uninitialized $(WERROR)
# array temporaries are no faults, and telling of them would fill standard error
CHECKED  = -O0 -g -fcheck=all,no-array-temps -fbacktrace -ffpe-trap=invalid,zero,overflow -finit-real=snan
BUILD    := $(if $(filter 1,$(DEBUG)),debug,release)
B        := build/$(BUILD)
SUFFIX   := $(BUILD:%=-%)
SUFFIX   := $(SUFFIX:-release=)
FLAGS_release  = $(FFLAGS) -fno-backtrace $(if $(filter 1,$(NATIVE)),-march=native)
FLAGS_debug    = $(CHECKED)
FLAGS_sanitize = -O1 -g -fsanitize=address,undefined -fno-sanitize-recover=undefined
FLAGS_coverage = -O0 -g --coverage
FLAGS_once     = $(if $(filter release,$(BUILD)),$(ONCE))
FLAGS          = $(STANDARD) $(FLAGS_$(BUILD))

# what runs once a deck: whole folders, but for analysis/transient, which runs in each step. The time of bounds is
# that of LAPACK and of algebra; modes of bodies that turn slowly are found with fewer digits without optimisation
ONCE_FOLDERS = model/body/setup system/setup closing/assembly deck build stability analysis
RUNS_ONCE    = $(filter-out $(B)/analysis/transient/%,$(filter $(ONCE_FOLDERS:%=$(B)/%/%),$(1)))

SOURCES  := $(sort $(shell find src -name '*.f90'))
SYSTEM   := $(patsubst src/%.c,$(B)/%.o,$(shell find src -name '*.c'))
# modules of which there are two from one text: what is real(number) in it is complex in its twin, complex_...
TWINS    := $(foreach name,small_matrices banded band_lu elastic_block border_rows condensed_system elastic_columns \
              newton_condensation newton_correction,$(filter %/$(name).f90,$(SOURCES)))
COMPLEX  := $(patsubst %,$(B)/twin/complex_%,$(notdir $(TWINS)))
# modules from the table of keys
KEYS     := $(if $(wildcard src/deck/keys.txt),$(addprefix $(B)/deck/,deck_keys.f90 deck_values.f90 deck_take.f90))
VERSION  := $(B)/output/program_version.f90
NUMBER   := $(shell sed -n 's/^version = "\([^"]*\)".*/\1/p' pyproject.toml)
MADE     := $(COMPLEX) $(KEYS) $(VERSION)
MAIN     := $(B)/main.o
OBJECTS  := $(filter-out $(MAIN),$(SOURCES:src/%.f90=$(B)/%.o)) $(MADE:.f90=.o) $(SYSTEM)
LIBRARY  := $(B)/libbiela.a
BIELA    := bin/biela$(SUFFIX)
PROBE    := $(patsubst tests/%.f90,bin/%$(SUFFIX),$(sort $(wildcard tests/*.f90)))
TOYS     := $(patsubst tests/toys/%.f90,bin/%$(SUFFIX),$(sort $(wildcard tests/toys/*.f90)))
BENCH    := $(patsubst tests/bench/%.f90,bin/%$(SUFFIX),$(wildcard tests/bench/*.f90))
TOOLS    := build/toolchain.ok
VENV     := .venv/complete
RUN      := .venv/bin/python
INSTALLED = $(addprefix $(DESTDIR)$(PREFIX)/,bin/biela share/man/man1/biela.1 share/bash-completion/completions/biela \
              share/zsh/site-functions/_biela)
# these install a compiler where there is none; all others only tell that it is missing
INSTALLING = setup demo joints test test-anywhere test-debug bench bench-peer cost extremes fuzz faults rounding coverage mutants lint
export BIELA_SETUP ?= $(if $(filter $(INSTALLING),$(MAKECMDGOALS)),toolchain,check)

# make's own -j prevails over this one; what follows `clean` has to wait for it
ifeq ($(MAKELEVEL)$(filter clean,$(MAKECMDGOALS)),0)
  MAKEFLAGS += -j$(shell nproc 2>/dev/null || echo 1)
endif
export FC LDLIBS PYTHON
.DELETE_ON_ERROR:
.SUFFIXES:
.PHONY: all install uninstall debug sanitize probe demo joints test test-debug bench bench-peer cost extremes fuzz faults rounding coverage mutants documents lint setup clean help FORCE

all: $(BIELA)                      ## bin/biela
install: $(BIELA)                  ## the program, its manual page and completions for bash and zsh, below PREFIX
	@install -d $(dir $(INSTALLED))
	install -m 755 $(BIELA) $(word 1,$(INSTALLED))
	sed '1s/"biela"/"biela $(NUMBER)"/' share/biela.1 > $(word 2,$(INSTALLED)) && chmod 644 $(word 2,$(INSTALLED))
	install -m 644 share/biela.bash $(word 3,$(INSTALLED))
	install -m 644 share/_biela $(word 4,$(INSTALLED))
uninstall:                         ## removes what `make install` put below the same PREFIX (and DESTDIR)
	rm -f $(INSTALLED)
debug:                             ## bin/biela-debug: -O0 with every run-time check
	@$(MAKE) DEBUG=1 all
sanitize:                          ## bin/biela-sanitize: watches addresses and undefined behaviour
	@$(MAKE) BUILD=sanitize all
probe: $(PROBE) $(TOYS)    ## bin/probe, bin/tangent, bin/terms: the solver's inside, for the tests; toy kinds
setup: $(TOOLS) $(VENV)            ## compiler, LAPACK and the Python packages, whatever is missing

demo: $(BIELA) $(VENV)             ## the slider-crank, elastic against viscoelastic: figures and pictures
	@$(BIELA) --quiet input/slider_crank_elastic.nml input/slider_crank_viscoelastic.nml
	@$(RUN) post/plot.py results/slider_crank_elastic results/slider_crank_viscoelastic --columns qf4.qd qf4.qdd \
	  --labels undamped viscoelastic --title 'Slider-crank: rotation of the middle node' --output results/demo/slider_crank
	@$(RUN) post/animate.py results/slider_crank_elastic --exaggerate 30 --frames 60 --output results/demo/motion
	@$(RUN) post/sweep.py input/studies/damping.toml --biela $(BIELA) --no-pictures
joints: $(BIELA) $(VENV)           ## damping in the rod, in the joint, in both: table and picture
	@$(RUN) post/sweep.py input/studies/joints.toml --biela $(BIELA)

test: $(BIELA) $(PROBE) $(TOYS) $(BENCH) $(VENV)    ## all tests (the bench's program is built only)
	@BIELA=$(BIELA) PROBE=bin/probe$(SUFFIX) TANGENT=bin/tangent$(SUFFIX) TERMS=bin/terms$(SUFFIX) \
	  $(RUN) -m pytest -q -n $(JOBS) $(TESTS)
test-anywhere: tests/anywhere.sh $(BIELA) $(PROBE) $(TOYS) $(BENCH) $(VENV)   ## all tests as other machines run them: an hour
	@BIELA=$(BIELA) PROBE=bin/probe$(SUFFIX) TANGENT=bin/tangent$(SUFFIX) TERMS=bin/terms$(SUFFIX) JOBS=$(JOBS) TESTS=$(TESTS) sh $<
test-debug:                        ## all tests, against the checked build
	@$(MAKE) DEBUG=1 test

bench: tests/bench/bench.py $(BIELA) $(BENCH) $(VENV)       ## seconds a step, an element, a term, a link
	@BIELA=$(BIELA) $(RUN) $<
bench-peer: tests/bench/peer.py $(BIELA) $(VENV)            ## against exudyn, side by side
	@BIELA=$(BIELA) $(RUN) $<
cost: tests/bench/cost.py $(BIELA) $(VENV)                  ## BASE=commit: instructions of this program beside that commit's
	@BIELA=$(BIELA) BASE=$(BASE) $(RUN) $<
extremes: tests/extremes/extremes.py $(BIELA) $(VENV)       ## numerical stability at the extremes: a report
	@BIELA=$(BIELA) $(RUN) $<
	@BIELA=$(BIELA) BOUND_SCENES=200 $(RUN) -m pytest -q -n $(JOBS) tests/steps/test_turning_springs.py tests/steps/test_bound_laws.py
	@BIELA=$(BIELA) $(RUN) tests/extremes/friction_shares.py
	@BIELA=$(BIELA) ERROR_SCENES=100 $(RUN) -m pytest -q -s tests/dynamics/test_dopri5_scenes.py
	@BIELA=$(BIELA) $(RUN) -m pytest -q -n $(JOBS) -m long tests
fuzz: tests/fuzz/fuzz.py debug sanitize $(VENV)   ## FUZZ_CASES=2000 decks of all kinds, FUZZ_SEED=1, against both checked builds
	@$(RUN) $< bin/biela-debug bin/biela-sanitize
faults: tests/faults/faults.py $(BIELA) $(VENV)   ## failing system calls, limits, signals, damaged checkpoints: a report
	@BIELA=$(BIELA) $(RUN) $<
rounding: tests/rounding/rounding.py $(BIELA) $(VENV)   ## digits that rounding modes, fused operations and FLANG=flang-new leave
	@$(MAKE) B=build/off SUFFIX=-off FFLAGS='-O3 -ffp-contract=off' all
	@$(MAKE) B=build/fused SUFFIX=-fused FFLAGS='-O3 -ffp-contract=fast -march=native' all
	@! command -v $(FLANG) >/dev/null || $(MAKE) B=build/flang SUFFIX=-flang FC=$(FLANG) CC=cc STANDARD= FFLAGS=-O2 LDLIBS='$(LDLIBS) -lgfortran' all
	@$(RUN) $< $(BIELA) bin/biela-off bin/biela-fused bin/biela-flang
# `end module` stands for copies of types that the compiler makes, the first line of a long allocate for its failure alone; of
# billions gcovr would think that they are a fault of gcov
NO_LINE     = ^ *(end module.*|allocate \(.*&)$$
GCOVR       = --root . --filter src/ --gcov-ignore-parse-errors=all --gcov-suspicious-hits-threshold=0 --exclude-lines-by-pattern '$(NO_LINE)'
# branches of decisions alone: those of array expressions and allocations are the compiler's
NO_DECISION = ^(?! *(\w+: *)?(if|else if|do)\b).*
coverage: $(BIELA) $(VENV)         ## lines and branches of src/, lines of post/ that the tests reach: results/coverage_*.txt
	@$(MAKE) BUILD=coverage all probe
	@mkdir -p results; find build/coverage -name '*.gcda' -delete; rm -f .coverage*
	-@BIELA=bin/biela-coverage PROBE=bin/probe-coverage TANGENT=bin/tangent-coverage TERMS=bin/terms-coverage \
	  $(RUN) -m coverage run -m pytest -q -n $(JOBS) $(TESTS)
	@$(RUN) -m gcovr $(GCOVR) --txt results/coverage_src.txt build/coverage
	@$(RUN) -m gcovr $(GCOVR) --txt results/coverage_branches.txt --txt-metric branch --exclude-branches-by-pattern '$(NO_DECISION)' \
	  build/coverage
	@$(RUN) -m coverage combine -q && $(RUN) -m coverage report --show-missing > results/coverage_post.txt
	@tail -n 2 results/coverage_src.txt results/coverage_branches.txt results/coverage_post.txt
mutants: tests/mutants/mutants.py $(BIELA) $(PROBE) $(VENV)   ## MUTANTS=20 small mistakes in src/, SEED=1: which does no test notice?
	@$(RUN) $<

documents:                         ## the tables of keys in input/README.md, the manual page and the completions
	@for file in input/README.md share/biela.1 share/biela.bash share/_biela; do \
	  awk -f src/deck/keys.awk -f share/documents.awk src/deck/keys.txt $$file > $$file.new && mv $$file.new $$file || exit 1; done

lint: $(VENV)                      ## fortitude and ruff
	@.venv/bin/fortitude check --quiet src tests
	@.venv/bin/ruff check --quiet src post tests

clean:                             ## remove what make made, the results and .venv left alone
	rm -rf build bin
help:                              ## this list
	@awk -F '## ' '/^[a-z-]+:.*## / { sub(/:.*/, "", $$1); printf "  make %-12s %s\n", $$1, $$2 }' Makefile
	@echo '  options: see the head of the Makefile'

# --- set-up: each file is made once, where setup.sh finds or has installed what is needed
$(TOOLS): setup.sh
	@./setup.sh $(BIELA_SETUP) && mkdir -p $(@D) && touch $@
$(VENV): requirements.txt setup.sh | $(TOOLS)
	@./setup.sh python && touch $@

# --- what a change of compiler, options or of the list of sources makes out of date
BUILT_BY = $(FC) $(FLAGS) $(FLAGS_once) $(LDLIBS)
$(B)/flags: FORCE
	@mkdir -p $(@D); [ "$$(cat $@ 2>&1)" = '$(BUILT_BY)' ] || { echo '$(BUILT_BY)' > $@.new && mv $@.new $@; }
$(B)/sources: FORCE
	@mkdir -p $(@D); [ "$$(cat $@ 2>&1)" = '$(SOURCES)' ] || { echo '$(SOURCES)' > $@.new && mv $@.new $@; }

# --- the complex twins: their text, with the names of twins in it
NAMES    := $(subst $(eval ) ,\|,$(notdir $(TWINS:.f90=)))
define twin
$(B)/twin/complex_$(notdir $(1)): $(1) Makefile
	@mkdir -p $$(@D); sed -e 's/real(number)/complex(number)/g' -e '/^ *\(end \)*module\|^ *use/s/\b\($(NAMES)\)\b/complex_&/' $$< > $$@.new && mv $$@.new $$@
endef
$(foreach file,$(TWINS),$(eval $(call twin,$(file))))

# --- records, what reads them, and the table as data, from the table of keys
TABLE    := src/deck/keys.awk src/deck/keys.txt
$(KEYS): $(B)/deck/%.f90: $(TABLE) src/deck/keys_fortran.awk
	@mkdir -p $(@D); awk -v make=$* -f src/deck/keys.awk -f src/deck/keys_fortran.awk src/deck/keys.txt > $@.new && mv $@.new $@

$(VERSION): pyproject.toml
	@mkdir -p $(@D); printf '!> The number of this version.\nmodule program_version\n  implicit none (type, external)\n  private\n  %s\nend module program_version\n' \
	  "character(*), parameter, public :: version = '$(NUMBER)'" > $@.new && mv $@.new $@

# --- objects, the archive of all modules, programs; -J writes the .mod file beside every other one, and leaves one that
# would not change as it is: what uses a module is compiled again where its interface has changed, not its inside
$(B)/%.o: src/%.f90 $(B)/flags | $(TOOLS)
	@mkdir -p $(@D) $(B)/mod
	$(FC) $(FLAGS) $(if $(call RUNS_ONCE,$@),$(FLAGS_once)) -J$(B)/mod -c $< -o $@.new && mv $@.new $@
$(MADE:.f90=.o): %.o: %.f90 $(B)/flags | $(TOOLS)
	@mkdir -p $(B)/mod
	$(FC) $(FLAGS) $(if $(call RUNS_ONCE,$@),$(FLAGS_once)) -J$(B)/mod -c $< -o $@.new && mv $@.new $@
$(B)/%.o: src/%.c $(B)/flags | $(TOOLS)
	@mkdir -p $(@D)
	$(CC) -std=c11 -Wall -Wextra $(WERROR) $(or $(filter -O% -g -fsanitize%,$(FLAGS_$(BUILD))),-O2) -c $< -o $@.new && mv $@.new $@
$(LIBRARY): $(OBJECTS) $(B)/sources
	@rm -f $@ $@.new; ar rcs $@.new $(OBJECTS) && mv $@.new $@

define link
	@mkdir -p bin
	$(FC) $(FLAGS) -I$(B)/mod -J$(B)/mod $(filter %.f90 %.o,$^) $(LIBRARY) $(LDLIBS) -o $@.new && mv $@.new $@
endef
$(BIELA): $(MAIN) $(LIBRARY)
	$(link)
bin/%$(SUFFIX): tests/%.f90 $(LIBRARY) $(B)/flags
	$(link)
bin/%$(SUFFIX): tests/bench/%.f90 $(LIBRARY) $(B)/flags
	$(link)
bin/%$(SUFFIX): tests/toys/%.f90 $(LIBRARY) $(B)/flags
	$(link)

# --- the order of compilation, read from the `module` and `use` lines
define DEPENDENCIES
{ line = tolower($$0); sub(/!.*/, "", line); gsub(/[,:()]/, " ", line); n = split(line, word, " ") }
FNR == 1 { object = FILENAME; sub(/^src/, "$(B)", object); sub(/f90$$/, "o", object) }
word[1] == "module" && n == 2 { home[word[2]] = object; print "$(B)/mod/" word[2] ".mod: " object " ;" }
(word[1] == "use" && word[2] != "intrinsic") || word[1] == "submodule" { edge[object " " word[2]] }
END { for (e in edge) { split(e, part, " "); if (part[2] in home && home[part[2]] != part[1]) print part[1] ": $(B)/mod/" part[2] ".mod" } }
endef
export DEPENDENCIES
$(B)/depend.mk: $(SOURCES) $(MADE) $(B)/sources Makefile
	@awk "$$DEPENDENCIES" $(SOURCES) $(MADE) > $@.new && mv $@.new $@
ifneq ($(filter-out clean documents help lint setup uninstall debug sanitize coverage test-debug,$(or $(MAKECMDGOALS),all)),)
  include $(B)/depend.mk
endif
