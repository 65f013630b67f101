!> A joint that the program does not have, from one file: a guide along the parabola y = x2/(2 R) that is fixed to the ground. It
!> takes the marker of a deck's first joint, which has one row: toy_guide DECK FOLDER R runs the deck's analyses with it.
module parabola
  use kinds, only: wp
  use constraint, only: constraint_model, constraint_rows, marker_stiffness
  use marker, only: marker_states
  implicit none (type, external)
  private

  !> y - x2/(2 R) = 0 of marker a.
  type, extends(constraint_model), public :: parabola_model
    real(wp) :: radius = 1.0_wp             !! of curvature at the bottom [m]
  contains
    procedure :: evaluate
    procedure :: acts_on
    procedure :: geometric
    procedure :: components
  end type parabola_model

contains

  !> It acts on the position of a.
  pure function acts_on(self) result(yes)
    class(parabola_model), intent(in) :: self
    logical :: yes(6)
    yes = [.true., .true., .false., .false., .false., .false.]
  end function acts_on

  !> The row, its gradient, and what curvature adds to its second derivative.
  pure subroutine evaluate(self, t, p, r)
    class(parabola_model), intent(in) :: self
    real(wp), intent(in) :: t               !! [s]
    type(marker_states), intent(in) :: p
    type(constraint_rows), intent(inout) :: r
    associate (i => self%first, x => p%r(:, self%ia))
      r%na(:, i) = [-x(1)/self%radius, 1.0_wp]
      r%nb(:, i) = 0.0_wp
      r%sa(i) = 0.0_wp
      r%sb(i) = 0.0_wp
      r%phi(i) = x(2) - x(1)**2/(2*self%radius)
      r%phi_t(i) = 0.0_wp
      r%acceleration_bias(i) = -p%v(1, self%ia)**2/self%radius
    end associate
  end subroutine evaluate

  !> -lambda/R along x.
  pure subroutine geometric(self, p, lambda, k)
    class(parabola_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: lambda(:)       !! [N]
    type(marker_stiffness), intent(inout) :: k
    k%k = 0.0_wp
    k%k(1, 1) = -lambda(self%first)/self%radius
  end subroutine geometric

  !> A parabola is not a line.
  pure function components(self, grounded) result(list)
    class(parabola_model), intent(in) :: self
    logical, intent(in) :: grounded
    integer, allocatable :: list(:)
    list = [1]
  end function components
end module parabola

!> Runs a deck with the guide in place of its first joint.
program toy_guide
  use build_scene, only: build
  use deck_reader, only: read_deck
  use errors, only: failure, fault_list
  use force_element, only: stage_transient
  use modal_analysis, only: run_modal
  use parabola, only: parabola_model
  use posix, only: make_folder
  use scene_model, only: scene
  use scene_run, only: run_state, assemble_run
  use summary_text, only: summary_record
  use transient, only: run_transient, transient_march
  implicit none (type, external)
  type(run_state) :: run
  type(scene) :: s
  type(parabola_model) :: new
  type(transient_march) :: march
  type(fault_list) :: faults
  type(failure) :: fail
  character(512) :: word(3)
  type(summary_record) :: text
  integer :: k
  do k = 1, 3
    call get_command_argument(k, word(k))
  end do
  read (word(3), *) new%radius
  call read_deck(trim(word(1)), run%d, faults)
  if (faults%count == 0) call build(run%d, s, faults)
  if (faults%count > 0) error stop 2, quiet=.true.
  associate (old => s%constraints(1)%item)
    new%name = old%name
    new%ia = old%ia
    new%ib = old%ib
    new%first = old%first
    new%rows = old%rows
    new%size = old%size
  end associate
  deallocate (s%constraints(1)%item)
  allocate (s%constraints(1)%item, source=new)
  run%quiet = .true.
  run%folder = trim(word(2))
  call make_folder(run%folder)
  call assemble_run(run, s, fail)
  if (run%d%modal%present .and. .not. fail%happened()) call run_modal(run, text, fail)
  run%sys%options%stage = stage_transient
  if (run%d%transient%present .and. .not. fail%happened()) call run_transient(run, march, fail)
  if (fail%happened()) then
    write (*, '(a)') fail%message
    error stop 3, quiet=.true.
  end if
end program toy_guide
