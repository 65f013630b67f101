!> An explicit method that the program does not have, from its tableau: Heun's of order three. toy_tableau DECK STEP STEPS marches
!> a deck's scene and prints the state at the end, positions first.
program toy_tableau
  use kinds, only: wp
  use deck_reader, only: read_deck
  use errors, only: failure, fault_list
  use fixed_step, only: fixed_stepper
  use scene_run, only: run_state, prepare_run
  use tableaux, only: tableau
  use time_stepper, only: reached
  implicit none (type, external)
  type(run_state) :: run
  type(fixed_stepper) :: march
  type(fault_list) :: faults
  type(failure) :: fail
  character(512) :: word(3)
  real(wp) :: step
  integer :: k, steps, outcome
  do k = 1, 3
    call get_command_argument(k, word(k))
  end do
  read (word(2), *) step
  read (word(3), *) steps
  call read_deck(trim(word(1)), run%d, faults)
  if (faults%count == 0) call prepare_run(run, faults, fail)
  if (faults%count > 0 .or. fail%happened()) error stop 2, quiet=.true.
  march%method = heun()
  march%settings%step = step
  call march%begin(run%sys, 0.0_wp, run%y)
  call march%advance(run%sys, 0.0_wp, steps*step, steps, run%y, outcome)
  if (outcome /= reached) error stop 3, quiet=.true.
  write (*, '(*(1x, es23.16))') run%y

contains

  !> Heun's method: nodes 0, 1/3, 2/3, weights 1/4, 0, 3/4.
  pure function heun() result(m)
    type(tableau) :: m
    m%stages = 3
    m%order = 3
    allocate (m%a(3, 3), source=0.0_wp)
    m%a(1, 2) = 1/3.0_wp
    m%a(2, 3) = 2/3.0_wp
    m%b = [0.25_wp, 0.0_wp, 0.75_wp]
    m%c = [0.0_wp, 1/3.0_wp, 2/3.0_wp]
    m%curve = [-1.5_wp, 1.5_wp, 0.0_wp]
  end function heun
end program toy_tableau
