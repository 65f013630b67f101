!> A force element that the program does not have, from one file: a bumper with a gap. It takes the markers of a deck's first
!> spring: toy_bumper DECK FOLDER GAP STIFFNESS runs the deck's analyses with it.
module bumper
  use kinds, only: wp
  use constraint, only: marker_stiffness
  use force_element, only: force_model, conditions, element_action
  use marker, only: marker_states
  implicit none (type, external)
  private

  !> Pushes a up, away from b, with stiffness times the square of how far it is below the gap.
  type, extends(force_model), public :: bumper_model
    real(wp) :: gap = 0.0_wp                !! least height of a above b without a force [m]
    real(wp) :: hardness = 0.0_wp           !! [N/m2]
  contains
    procedure :: act
    procedure :: tangent
    procedure :: energy
  end type bumper_model

contains

  !> How far a is below the gap.
  pure real(wp) function depth(self, p)     ! [m]
    class(bumper_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    depth = max(0.0_wp, self%gap - (p%r(2, self%ia) - p%r(2, self%ib)))
  end function depth

  !> The force up on a and down on b.
  pure subroutine act(self, p, with, z, zd, zdd, x)
    class(bumper_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: z(*), zd(*)     !! not used [-]
    real(wp), intent(inout) :: zdd(*)       !! not used [-]
    type(element_action), intent(inout) :: x
    x%force = self%hardness*depth(self, p)**2
    x%a = [0.0_wp, x%force, 0.0_wp]
    x%b = -x%a
  end subroutine act

  !> Twice the hardness times the depth, between the heights.
  pure subroutine tangent(self, p, with, part, force, k)
    class(bumper_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    type(conditions), intent(in) :: with
    real(wp), intent(in) :: part(2)         !! [-]
    real(wp), intent(in) :: force           !! [N]
    type(marker_stiffness), intent(inout) :: k
    k%k = 0.0_wp
    k%c = 0.0_wp
    k%k([2, 5], 2) = 2*self%hardness*depth(self, p)*[1, -1]
    k%k([2, 5], 5) = -k%k([2, 5], 2)
  end subroutine tangent

  !> A third of the hardness times the cube of the depth.
  pure real(wp) function energy(self, p, z, zd)   ! [J]
    class(bumper_model), intent(in) :: self
    type(marker_states), intent(in) :: p
    real(wp), intent(in) :: z(*), zd(*)     !! not used [-]
    energy = self%hardness*depth(self, p)**3/3
  end function energy
end module bumper

!> Runs a deck with a bumper in place of its first spring.
program toy_bumper
  use build_scene, only: build
  use bumper, only: bumper_model
  use deck_reader, only: read_deck
  use errors, only: failure, fault_list
  use force_element, only: stage_transient
  use modal_analysis, only: run_modal
  use posix, only: make_folder
  use scene_model, only: scene
  use scene_run, only: run_state, assemble_run
  use static_analysis, only: run_static
  use summary_text, only: summary_record
  use transient, only: run_transient, transient_march
  implicit none (type, external)
  type(run_state) :: run
  type(scene) :: s
  type(bumper_model) :: new
  type(transient_march) :: march
  type(fault_list) :: faults
  type(failure) :: fail
  character(512) :: word(4)
  type(summary_record) :: text
  integer :: k
  do k = 1, 4
    call get_command_argument(k, word(k))
  end do
  read (word(3), *) new%gap
  read (word(4), *) new%hardness
  new%acts([2, 5]) = .true.
  call read_deck(trim(word(1)), run%d, faults)
  if (faults%count == 0) call build(run%d, s, faults)
  if (faults%count > 0) error stop 2, quiet=.true.
  new%name = s%forces(1)%item%name
  new%ia = s%forces(1)%item%ia
  new%ib = s%forces(1)%item%ib
  deallocate (s%forces(1)%item)
  allocate (s%forces(1)%item, source=new)
  run%quiet = .true.
  run%folder = trim(word(2))
  call make_folder(run%folder)
  call assemble_run(run, s, fail)
  if (run%d%static%present .and. .not. fail%happened()) call run_static(run, text, fail)
  if (run%d%modal%present .and. .not. fail%happened()) call run_modal(run, text, fail)
  run%sys%options%stage = stage_transient
  if (run%d%transient%present .and. .not. fail%happened()) call run_transient(run, march, fail)
  if (fail%happened()) then
    write (*, '(a)') fail%message
    error stop 3, quiet=.true.
  end if
end program toy_bumper
