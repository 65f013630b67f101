!> Force elements as wrenches on their markers, and what these do to the frames and the elastic coordinates (theory.md,
!> section 3). Wrenches are kept in body axes.
module marker_forces
  use kinds, only: wp
  use controls, only: put_out
  use evaluation_settings, only: evaluation_options
  use force_element, only: by_position, conditions, element_action, inactive
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: applied_forces, load_frames, load_elastic

contains

  !> Force elements as wrenches on their markers; adds to the powers.
  subroutine applied_forces(self, ev, options, t, z, zd)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz) [m, rad] and rates
    type(conditions) :: with
    integer :: k, b
    do k = 1, size(self%s%loaded)
      ev%wrench(:, self%s%loaded(k)) = 0.0_wp
    end do
    do k = 1, size(self%s%controllers)
      call put_out(self, ev, options, t, z, k)
    end do
    if (size(self%s%factors) > 0) call find_factors(self, ev, options, t)
    with = conditions(t, options%left_limit, options%stage, options%load_factor, options%prestress)
    do k = 1, self%s%acting
      associate (f => self%s%forces(k)%item, x => ev%action(k))
        if (f%controller > 0) with%signal = ev%control(f%controller)%output
        if (f%motion_factor > 0) with%signal = ev%factor(f%motion_factor)%value
        if (f%switch_number > 0) then
          with%state = ev%switches%state(f%switch_number)
          with%event_value = ev%switches%event_value(f%switch_number)
          if (with%state == inactive) then
            x = element_action()
            cycle
          end if
        end if
        b = self%markers%body(f%ia)
        if (b > 0) with%axes = [ev%frame%cos(b), ev%frame%sin(b)]
        call f%act(ev%p, with, z, zd, ev%zdd, x)
        ev%dissipated_power = ev%dissipated_power + x%dissipated
        ev%input_power = ev%input_power + x%input
        call add_wrench(self, ev, f%ia, x%a)
        if (f%ib /= f%ia) call add_wrench(self, ev, f%ib, x%b)
      end associate
    end do
  end subroutine applied_forces

  !> Factors of loads that follow motions, from what the watches see.
  subroutine find_factors(self, ev, options, t)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    type(evaluation_options), intent(in) :: options
    real(wp), intent(in) :: t               !! [s]
    type(conditions) :: with
    integer :: k
    with = conditions(t, options%left_limit, options%stage, options%load_factor)
    do k = 1, size(ev%signals, 2)
      associate (f => self%s%forces(self%s%acting + k)%item)
        with%state = by_position
        if (f%switch_number > 0) then
          with%state = ev%switches%state(f%switch_number)
          with%event_value = ev%switches%event_value(f%switch_number)
        end if
        call f%signal(ev%p, with, ev%signals(:, k))
      end associate
    end do
    do k = 1, size(ev%factor)
      call self%s%factors(k)%evaluate(t, options%left_limit, ev%signals, .not. options%load_factor > 0.0_wp, &
                                      ev%factor(k)%value, ev%factor(k)%slopes)
    end do
  end subroutine find_factors

  !> Adds a force (global axes) and a moment to a marker.
  pure subroutine add_wrench(self, ev, k, w)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: k                !! marker
    real(wp), intent(in) :: w(3)            !! [N], [N m]
    integer :: b
    b = self%markers%body(k)
    if (b == 0) return
    ev%wrench(1, k) = ev%wrench(1, k) + ev%frame%cos(b)*w(1) + ev%frame%sin(b)*w(2)
    ev%wrench(2, k) = ev%wrench(2, k) - ev%frame%sin(b)*w(1) + ev%frame%cos(b)*w(2)
    ev%wrench(3, k) = ev%wrench(3, k) + w(3)
  end subroutine add_wrench

  !> Wrenches on markers act on the frames: A^T F, (H rho).A^T F + M.
  pure subroutine load_frames(self, ev)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    integer :: j, k, b
    do j = 1, size(self%s%loaded)
      k = self%s%loaded(j)
      if (max(abs(ev%wrench(1, k)), abs(ev%wrench(2, k)), abs(ev%wrench(3, k))) <= 0.0_wp) cycle   ! most stops are open
      b = self%markers%body(k)
      ev%frame%rhs(1:2, b) = ev%frame%rhs(1:2, b) + ev%wrench(1:2, k)
      ev%frame%rhs(3, b) = ev%frame%rhs(3, b) + ev%wrench(3, k) + ev%p%rho(1, k)*ev%wrench(2, k) - ev%p%rho(2, k)*ev%wrench(1, k)
    end do
  end subroutine load_frames

  !> Wrenches on markers act on the elastic coordinates there.
  pure subroutine load_elastic(self, ev, b)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: b
    integer :: j, k
    do j = self%s%loaded_first(b), self%s%loaded_first(b + 1) - 1
      k = self%s%loaded(j)
      call self%s%markers(k)%add_elastic_forces(ev%wrench(:, k), ev%elastic(b)%force(1:))
    end do
  end subroutine load_elastic
end module marker_forces
