!> A joint that the program does not have, from one file: a pair of gears, which acts by moments alone. It takes the markers of a
!> deck's first joint: toy_gear DECK FOLDER RATIO runs the deck's static analysis with it.
module gear
  use kinds, only: wp
  use constraint, only: constraint_model, constraint_rows
  use marker, only: marker_states
  implicit none (type, external)
  private

  !> angle_a + ratio angle_b = 0.
  type, extends(constraint_model), public :: gear_model
    real(wp) :: ratio = 1.0_wp              !! turns of a for one of b, the other way [-]
  contains
    procedure :: evaluate
    procedure :: acts_on
  end type gear_model

contains

  !> The row.
  pure subroutine evaluate(self, t, p, r)
    class(gear_model), intent(in) :: self
    real(wp), intent(in) :: t               !! [s]
    type(marker_states), intent(in) :: p
    type(constraint_rows), intent(inout) :: r
    associate (i => self%first)
      call r%empty(i)
      r%sa(i) = self%size
      r%sb(i) = self%size*self%ratio
      r%phi(i) = self%size*(p%angle(self%ia) + self%ratio*p%angle(self%ib))
    end associate
  end subroutine evaluate

  !> Moments on both sections.
  pure function acts_on(self) result(yes)
    class(gear_model), intent(in) :: self
    logical :: yes(6)
    yes = [.false., .false., .true., .false., .false., .true.]
  end function acts_on
end module gear

!> Runs a deck's static analysis with the gears in place of its first joint.
program toy_gear
  use build_scene, only: make_elements, place_elements
  use deck_reader, only: read_deck
  use errors, only: failure, fault_list
  use gear, only: gear_model
  use posix, only: make_folder
  use scene_model, only: scene
  use scene_run, only: run_state, assemble_run
  use static_analysis, only: run_static
  use summary_text, only: summary_record
  implicit none (type, external)
  type(run_state) :: run
  type(scene) :: s
  type(gear_model) :: new
  type(fault_list) :: faults
  type(failure) :: fail
  character(512) :: word(3)
  type(summary_record) :: text
  integer :: k
  do k = 1, 3
    call get_command_argument(k, word(k))
  end do
  read (word(3), *) new%ratio
  call read_deck(trim(word(1)), run%d, faults)
  if (faults%count == 0) call make_elements(run%d, s, faults)
  if (faults%count > 0) error stop 2, quiet=.true.
  new%name = s%constraints(1)%item%name
  new%rows = 1
  deallocate (s%constraints(1)%item)
  allocate (s%constraints(1)%item, source=new)
  call place_elements(run%d, s, faults)
  if (faults%count > 0) error stop 2, quiet=.true.
  run%quiet = .true.
  run%folder = trim(word(2))
  call make_folder(run%folder)
  call assemble_run(run, s, fail)
  if (.not. fail%happened()) call run_static(run, text, fail)
  if (fail%happened()) then
    write (*, '(a)') fail%message
    error stop 3, quiet=.true.
  end if
end program toy_gear
