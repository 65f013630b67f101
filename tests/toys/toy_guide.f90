!> A joint that the program does not have, from one file: a guide along the parabola y = x2/(2 R) that is fixed to the ground. It
!> takes the marker of a deck's first joint, which has one row: toy_guide DECK FOLDER R runs the deck's analyses with it.
module parabola
  use kinds, only: wp
  use marker, only: marker_states
  use measure, only: measure_course, measure_model, measured
  implicit none (type, external)
  private

  !> y - x2/(2 R) of marker a.
  type, extends(measure_model), public :: parabola_measure
    real(wp) :: radius = 1.0_wp             !! of curvature at the bottom [m]
  contains
    procedure :: measure => motion
    procedure :: course
    procedure :: curvature
  end type parabola_measure

contains

  !> Its value, its motion, and what curvature adds to its second derivative.
  pure subroutine motion(self, p, now)
    class(parabola_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(measured), intent(out) :: now
    associate (x => p%r(:, self%ia), v => p%v(:, self%ia))
      now%x = x(2) - x(1)**2/(2*self%radius)
      now%rate = v(2) - x(1)*v(1)/self%radius
      now%g = 0.0_wp
      now%g(1:2) = [-x(1)/self%radius, 1.0_wp]
      now%bias = -v(1)**2/self%radius
    end associate
  end subroutine motion

  !> It bends by x: no stop limits it, so that nothing asks how much.
  pure type(measure_course) function course(self, p) result(c)
    class(parabola_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    c%turning = self%spin(p)
    c%bend = huge(1.0_wp)
  end function course

  !> -1/R along x.
  pure subroutine curvature(self, p, h)
    class(parabola_measure), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(out) :: h(6, 6)        !! [1/m]
    h = 0.0_wp
    h(1, 1) = -1/self%radius
  end subroutine curvature
end module parabola

!> Runs a deck with the guide in place of its first joint.
program toy_guide
  use build_scene, only: build
  use constraint, only: constraint_model
  use deck_reader, only: read_deck
  use errors, only: failure, fault_list
  use force_element, only: stage_transient
  use modal_analysis, only: run_modal
  use parabola, only: parabola_measure
  use posix, only: make_folder
  use scene_model, only: scene
  use scene_run, only: run_state, assemble_run
  use summary_text, only: summary_record
  use transient, only: run_transient, transient_march
  implicit none (type, external)
  type(run_state) :: run
  type(scene) :: s
  type(parabola_measure) :: guide
  type(constraint_model) :: new
  type(transient_march) :: march
  type(fault_list) :: faults
  type(failure) :: fail
  character(512) :: word(3)
  type(summary_record) :: text
  integer :: k
  do k = 1, 3
    call get_command_argument(k, word(k))
  end do
  read (word(3), *) guide%radius
  guide%acts(1:2) = .true.
  call read_deck(trim(word(1)), run%d, faults)
  if (faults%count == 0) call build(run%d, s, faults)
  if (faults%count > 0) error stop 2, quiet=.true.
  associate (old => s%constraints(1)%item)
    new%name = old%name
    new%first = old%first
    new%size = old%size
    call new%hold(guide)
    call new%attach(old%ia, old%ib, 0)
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
