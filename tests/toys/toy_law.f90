!> A viscoelastic law that the program does not have, from one file: a power law (springpot) beside the static stiffness,
!> E(s)/E_R = 1 + (tau s)^beta. toy_law DECK FOLDER BETA TAU runs the deck's analyses with it on the deck's first spring.
module power_law
  use kinds, only: wp, pi
  use viscoelastic_law, only: viscoelastic_terms
  implicit none (type, external)
  private
  public :: power_terms

  real(wp), parameter :: slowest = 1.0e-8_wp, fastest = 1.0e5_wp   !! rates of the first and last term, in 1/tau [-]

contains

  !> s^beta = sin(pi beta)/pi integral of x^beta (s/x)/(1 + s/x) du over x = exp(u), by the trapezoidal rule.
  pure type(viscoelastic_terms) function power_terms(beta, tau) result(t)
    real(wp), intent(in) :: beta            !! exponent [-]
    real(wp), intent(in) :: tau             !! time [s]
    integer, parameter :: n = 60
    real(wp) :: x(n), step                  ! rates times tau, interval of their logarithm [-]
    integer :: k
    step = log(fastest/slowest)/(n - 1)
    x = [(slowest*exp(step*(k - 1)), k=1, n)]
    t = viscoelastic_terms(0, n, sin(pi*beta)/pi*step*x**beta, tau/x, 0*x)
  end function power_terms
end module power_law

!> Runs a deck with the law on its first spring.
program toy_law
  use build_scene, only: build, number_internal
  use deck_reader, only: read_deck
  use errors, only: failure, fault_list
  use force_element, only: stage_transient
  use posix, only: make_folder
  use kinds, only: wp
  use power_law, only: power_terms
  use response_analysis, only: run_response
  use scene_model, only: scene
  use scene_run, only: run_state, assemble_run
  use summary_text, only: summary_record
  use transient, only: run_transient, transient_march
  implicit none (type, external)
  type(run_state) :: run
  type(scene) :: s
  real(wp) :: beta, tau
  type(transient_march) :: march
  type(fault_list) :: faults
  type(failure) :: fail
  character(512) :: word(4)
  type(summary_record) :: text
  integer :: k
  do k = 1, 4
    call get_command_argument(k, word(k))
  end do
  read (word(3), *) beta
  read (word(4), *) tau
  call read_deck(trim(word(1)), run%d, faults)
  if (faults%count == 0) call build(run%d, s, faults)
  if (faults%count > 0) error stop 2, quiet=.true.
  s%forces(1)%item%law = power_terms(beta, tau)
  call number_internal(s)
  run%quiet = .true.
  run%folder = trim(word(2))
  call make_folder(run%folder)
  call assemble_run(run, s, fail)
  if (run%d%response%present .and. .not. fail%happened()) call run_response(run, text, fail)
  run%sys%options%stage = stage_transient
  if (run%d%transient%present .and. .not. fail%happened()) call run_transient(run, march, fail)
  if (fail%happened()) then
    write (*, '(a)') fail%message
    error stop 3, quiet=.true.
  end if
end program toy_law
