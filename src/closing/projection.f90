!> Projection of a state onto Phi = 0 and then Phi' = 0, mass-orthogonally (theory.md, section 6), with the factors of the
!> last evaluation. Corrections are as small as the error of the step, so that slightly old factors only cost one more pass.
!> Positions of mechanisms with flexible bodies are corrected in the frames alone wherever these can close the joints well
!> (`frame_closing`).
module projection
  use kinds, only: wp
  use dynamics, only: evaluate, marker_kinematics, constraint_values, row_rates, apply_multipliers
  use evaluation_settings, only: evaluation_options, with_weak_pivots
  use frame_closing, only: prepare_frames, close_frames
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: project, violations

  integer, parameter :: most_passes = 30             !! corrections before giving up
  real(wp), parameter :: position_goal = 10*epsilon(1.0_wp)   !! |Phi| wanted, relative to the scene's size [-]
  real(wp), parameter :: rate_goal = 20*epsilon(1.0_wp)       !! |Phi'| wanted, relative to the fastest marker [-]
  real(wp), parameter, public :: closed = 1.0e-12_wp   !! |Phi| of a closed mechanism, relative to the scene's size [-]
  real(wp), parameter :: angle_rounding = 16*epsilon(1.0_wp)   !! likewise, for each radian of a body's angle [-]
  real(wp), parameter :: angle_digits = epsilon(1.0_wp)        !! what of that no correction mends [-]
  real(wp), parameter :: nearly = 1.0e-4_wp          !! |Phi| from which weak pivots are tried at a nearly singular position [-]

contains

  !> Projects positions, then velocities. ok is false where Phi = 0 cannot be met near the state.
  subroutine project(self, ev, options, t, q, v, z, zd, ok)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t                !! [s]
    real(wp), intent(inout), contiguous :: q(:), v(:)   !! (nq) [m, rad], [m/s, rad/s]
    real(wp), intent(in), contiguous :: z(:), zd(:)     !! (nz) [m, rad], [m/s, rad/s]
    logical, intent(out) :: ok
    ok = .true.
    if (self%s%rows == 0) return
    call project_positions(self, ev, options, t, q, v, z, zd, ok)
    if (.not. ok) return
    if (determined(self) .and. .not. any(abs(ev%rows%phi_t) > 0.0_wp)) then
      v = 0.0_wp                             ! joints and drives at rest allow no motion, also in singular positions
      return
    end if
    call project_velocities(self, ev, q, v)
    if (ev%schur%singular .and. determined(self)) then
      call evaluate(self, ev, with_weak_pivots(options), t, q, v, z, zd)
      if (.not. ev%schur%singular) call project_velocities(self, ev, q, v)
    end if
  end subroutine project

  !> Whether joints and drives leave no freedom.
  pure logical function determined(self) result(yes)
    type(mechanism_model), intent(in) :: self
    yes = self%s%permanent_rows == self%s%nq .and. .not. self%redundant
  end function determined

  !> Newton corrections of the positions; new factors where old ones converge slowly.
  subroutine project_positions(self, ev, options, t, q, v, z, zd, ok)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t   !! [s]
    real(wp), intent(inout), contiguous :: q(:)   !! (nq) [m, rad]
    real(wp), intent(in), contiguous :: v(:), z(:), zd(:)   !! (nq), (nz) [m, rad], [m/s, rad/s]
    logical, intent(out) :: ok
    real(wp) :: worst, before, goal, enough, turned   ! [m]
    integer :: pass
    logical :: by_frames
    turned = self%s%size*largest(size(ev%frame%angle), ev%frame%angle)
    goal = position_goal*(self%s%size + largest(size(ev%p%r), ev%p%r))
    enough = max(closed*self%s%size, 16*goal, angle_rounding*turned)
    before = huge(1.0_wp)
    do pass = 1, most_passes
      call marker_kinematics(self, ev, q, v)
      call constraint_values(self, ev, options, t)
      worst = largest(self%s%rows, ev%rows%phi)
      if (.not. worst > goal) exit
      if (worst <= angle_digits*turned) then
        if (is_rounding(self, ev, goal)) exit
      end if
      if (worst > 0.5_wp*before .and. worst <= enough) exit
      if (worst > 0.1_wp*before) then
        if (pass > 3 .and. worst > 0.5_wp*before .and. pass > most_passes/2) exit
        call evaluate(self, ev, options, t, q, v, z, zd)
        if (pass > 2 .and. ev%schur%singular .and. determined(self) .and. worst <= nearly*self%s%size) then
          call evaluate(self, ev, with_weak_pivots(options), t, q, v, z, zd)
        end if
        by_frames = .false.
        if (worst <= enough) call prepare_frames(self, ev, by_frames)
      end if
      if (pass == 1) call prepare_frames(self, ev, by_frames)
      before = worst
      ev%lambda = ev%rows%phi
      if (by_frames) then
        call close_frames(self, ev, ev%lambda, q)
      else
        call ev%schur%solve(ev%lambda)
        call apply_multipliers(self, ev, ev%lambda, ev%a)
        q = q + ev%a
      end if
    end do
    ok = worst <= enough
  end subroutine project_positions

  !> Whether all rows are closed but for the last digits of angles, those of a row's own bodies: turns made cost no corrections.
  pure logical function is_rounding(self, ev, goal) result(yes)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    real(wp), intent(in) :: goal              !! |Phi| wanted where nothing has turned [m]
    real(wp) :: left(self%s%rows)             ! [m]
    integer :: b, e
    left = abs(ev%rows%phi) - goal
    associate (side => self%incidence)
      do b = 1, size(self%s%bodies)
        do e = side%first(b), side%first(b + 1) - 1
          left(side%row(e)) = left(side%row(e)) - angle_digits*self%s%size*abs(ev%frame%angle(b))
        end do
      end do
    end associate
    yes = all(left <= 0.0_wp)
  end function is_rounding

  !> Corrections of the velocities at fixed positions.
  subroutine project_velocities(self, ev, q, v)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(in), contiguous :: q(:)   !! (nq) [m, rad]
    real(wp), intent(inout), contiguous :: v(:)   !! (nq) [m/s, rad/s]
    real(wp) :: worst, before, goal
    integer :: pass
    before = huge(1.0_wp)
    goal = rate_goal*(largest(size(ev%p%v), ev%p%v) + self%s%size*largest(size(ev%p%rate), ev%p%rate))
    do pass = 1, 6
      call row_rates(self, ev, ev%lambda)
      worst = largest(self%s%rows, ev%lambda)
      if (.not. worst > goal .or. worst > 0.5_wp*before) exit
      before = worst
      call ev%schur%solve(ev%lambda)
      call apply_multipliers(self, ev, ev%lambda, ev%a)
      v = v + ev%a
      call marker_kinematics(self, ev, q, v)
    end do
  end subroutine project_velocities

  !> Largest absolute value, by four running maxima, which the processor finds at the same time.
  pure function largest(n, x) result(y)
    integer, intent(in) :: n
    real(wp), intent(in) :: x(n)   !! [any]
    real(wp) :: y, part(4)
    integer :: k, i
    part = 0.0_wp
    do k = 1, n - 3, 4
      do i = 1, 4
        part(i) = max(part(i), abs(x(k + i - 1)))
      end do
    end do
    do k = n - mod(n, 4) + 1, n
      part(1) = max(part(1), abs(x(k)))
    end do
    y = max(part(1), part(2), part(3), part(4))
  end function largest

  !> Largest violations of positions and velocities at the state of an evaluation (angle rows count times the scene's size).
  subroutine violations(self, ev, position, velocity)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp), intent(out) :: position, velocity      !! largest of all rows [m], [m/s]
    position = 0.0_wp
    velocity = 0.0_wp
    if (self%s%rows == 0) return
    call row_rates(self, ev, ev%schur%r)
    position = largest(self%s%rows, ev%rows%phi)
    velocity = largest(self%s%rows, ev%schur%r)
  end subroutine violations
end module projection
