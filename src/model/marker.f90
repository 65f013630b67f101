!> Markers: where joints, drives, springs, loads and sensors act. A marker is a point of the ground, a point or node of a
!> body with its section, or the frame of a body, on which only moments act.
module marker
  use kinds, only: wp
  implicit none (type, external)
  private
  public :: add_modes, turn

  !> A marker on a body.
  type, public :: marker_model
    integer :: body = 0                      !! 0: the ground
    integer :: node = 0                      !! node of a beam or frame, 0: a point or the frame itself
    real(wp) :: x(2) = 0.0_wp                !! undeformed position: body axes, global on the ground [m]
    integer :: dof(3) = 0                    !! its elastic coordinates (u, v, rotation), 0: none
    real(wp), allocatable :: psi(:, :)       !! modal bodies: (3, nf) displacements in each mode [1/kg^.5, 1/(kg^.5 m)]
  contains
    procedure :: elastic
    procedure :: displacement
    procedure :: add_wrench
    procedure :: add_elastic_forces
    procedure :: moves
  end type marker_model

  !> Kinematic state of all markers of a list.
  type, public :: marker_states
    real(wp), allocatable :: r(:, :)         !! (2, n) position, global [m]
    real(wp), allocatable :: v(:, :)         !! (2, n) velocity, global [m/s]
    real(wp), allocatable :: angle(:)        !! (n) angle of the section, or of the frame [rad]
    real(wp), allocatable :: rate(:)         !! (n) its rate [rad/s]
    real(wp), allocatable :: rho(:, :)       !! (2, n) x + u in body axes [m]
    real(wp), allocatable :: bias(:, :)      !! (2, n) velocity-dependent part of the acceleration, global [m/s2]
    real(wp), allocatable :: piece(:)        !! of each watched law, an argument on its present piece; huge: not known [rad]
  contains
    procedure :: allocate => allocate_states
  end type marker_states

contains

  !> Allocates the states of n markers, at rest at the origin.
  pure subroutine allocate_states(self, n)
    class(marker_states), intent(inout) :: self
    integer, intent(in) :: n
    allocate (self%r(2, n), self%v(2, n), self%angle(n), self%rate(n), self%rho(2, n), self%bias(2, n), source=0.0_wp)
  end subroutine allocate_states

  !> E_k x: what the marker sees of a vector of its body's elastic coordinates: u, v, rotation.
  pure function elastic(self, x) result(u)
    class(marker_model), intent(in) :: self
    real(wp), intent(in), contiguous :: x(:) !! (nf) [m, rad], or their rates
    real(wp) :: u(3)                         !! body axes
    integer :: c
    u = 0.0_wp
    if (allocated(self%psi)) then
      call add_modes(size(x), self%psi, x, u)
    else
      do c = 1, 3
        if (self%dof(c) > 0) u(c) = x(self%dof(c))
      end do
    end if
  end function elastic

  !> The same of a modal body, a loop of every evaluation: u <- u + Psi x.
  pure subroutine add_modes(n, psi, x, u)
    integer, intent(in) :: n
    real(wp), intent(in) :: psi(3, n), x(n)  !! displacements in each mode [1/kg^.5, 1/(kg^.5 m)], amplitudes [m kg^.5]
    real(wp), intent(inout) :: u(3)          !! [m, m, rad]
    integer :: c
    do c = 1, n
      u(1) = u(1) + psi(1, c)*x(c)
      u(2) = u(2) + psi(2, c)*x(c)
      u(3) = u(3) + psi(3, c)*x(c)
    end do
  end subroutine add_modes

  !> Displacement of the marker by small motions of its body's frame and elastic coordinates: [I, H rho, E_k] (theory.md,
  !> section 6).
  pure function displacement(self, rho, frame, x) result(u)
    class(marker_model), intent(in) :: self
    real(wp), intent(in) :: rho(2)           !! present position, body axes [m]
    real(wp), intent(in) :: frame(3)         !! of the frame, body axes: x, y, angle [m, m, rad]
    real(wp), intent(in), contiguous :: x(:) !! (nf) [m, rad]
    real(wp) :: u(3)                         !! body axes: u, v, rotation
    u = [frame(1:2) + frame(3)*turn(rho), frame(3)] + self%elastic(x)
  end function displacement

  !> The transpose of `displacement`: adds the generalised forces of a wrench on the marker.
  pure subroutine add_wrench(self, rho, w, frame, f)
    class(marker_model), intent(in) :: self
    real(wp), intent(in) :: rho(2)           !! present position, body axes [m]
    real(wp), intent(in) :: w(3)             !! force in body axes [N] and moment [N m]
    real(wp), intent(inout) :: frame(3)      !! on the frame, body axes [N, N, N m]
    real(wp), intent(inout) :: f(:)          !! (nf) on the elastic coordinates [N, N m]
    frame(1:2) = frame(1:2) + w(1:2)
    frame(3) = frame(3) + w(3) + rho(1)*w(2) - rho(2)*w(1)
    call self%add_elastic_forces(w, f)
  end subroutine add_wrench

  !> Its elastic part: adds E^T w.
  pure subroutine add_elastic_forces(self, w, f)
    class(marker_model), intent(in) :: self
    real(wp), intent(in) :: w(3)             !! force in body axes [N] and moment [N m]
    real(wp), intent(inout) :: f(:)          !! (nf) [N, N m]
    integer :: c
    if (allocated(self%psi)) then
      do c = 1, size(f)
        f(c) = f(c) + self%psi(1, c)*w(1) + self%psi(2, c)*w(2) + self%psi(3, c)*w(3)
      end do
    else
      do c = 1, 3
        if (self%dof(c) > 0) f(self%dof(c)) = f(self%dof(c)) + w(c)
      end do
    end if
  end subroutine add_elastic_forces

  !> Whether a component (u, v, rotation) moves with the elastic coordinates.
  pure logical function moves(self, c)
    class(marker_model), intent(in) :: self
    integer, intent(in) :: c
    moves = allocated(self%psi) .or. self%dof(c) > 0
  end function moves

  !> H x: a vector turned by +90 degrees.
  pure function turn(x) result(y)
    real(wp), intent(in) :: x(2)   !! [any]
    real(wp) :: y(2)
    y(1) = -x(2)
    y(2) = x(1)
  end function turn
end module marker
