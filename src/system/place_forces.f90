!> Springs and loads as wrenches on their places, and what these do to the frames and the elastic coordinates (theory.md,
!> section 3). Wrenches are kept in body axes: a force on body a of a spring is -f e, e the unit vector from b to a.
module place_forces
  use kinds, only: wp
  use mechanism, only: mechanism_model
  implicit none (type, external)
  private
  public :: applied_forces, load_frames, load_elastic

contains

  !> Springs and loads as wrenches on their places; adds to the powers.
  subroutine applied_forces(self, t, q, z, zd)
    type(mechanism_model), intent(inout) :: self
    real(wp), intent(in) :: t               !! [s]
    real(wp), intent(in), contiguous :: q(:)          !! (nq)
    real(wp), intent(in), contiguous :: z(:), zd(:)   !! (nz)
    real(wp) :: d, dd, e(2), f, power, force(2), moment, angle, scale
    integer :: k, b
    do k = 1, size(self%s%loaded)
      self%wrench(:, self%s%loaded(k)) = 0.0_wp
    end do
    do k = 1, size(self%s%springs)
      associate (sp => self%s%springs(k))
        call sp%deformation(self%p, d, dd, e)
        call sp%force(d, dd, z, zd, self%zdd, f, power)
        self%spring_force(k) = f
        self%dissipated_power = self%dissipated_power + power
        if (sp%torsional) then
          call add_wrench(self, sp%ia, [0.0_wp, 0.0_wp], -f)
          call add_wrench(self, sp%ib, [0.0_wp, 0.0_wp], f)
        else
          call add_wrench(self, sp%ia, -f*e, 0.0_wp)
          call add_wrench(self, sp%ib, f*e, 0.0_wp)
        end if
      end associate
    end do
    do k = 1, size(self%s%loads)
      associate (l => self%s%loads(k))
        if (.not. l%acts(self%stage)) cycle
        b = self%place_body(l%place)
        angle = 0.0_wp
        if (b > 0) angle = q(self%s%qo(b) + 3)
        scale = l%scale(t, self%left)*self%load_factor
        call l%wrench(self%p, angle, scale, force, moment)
        call add_wrench(self, l%place, force, moment)
        self%input_power = self%input_power + dot_product(force, self%p%v(:, l%place)) + moment*self%p%rate(l%place)
      end associate
    end do
  end subroutine applied_forces

  !> Adds a force (global axes) and a moment to a place.
  pure subroutine add_wrench(self, k, force, moment)
    type(mechanism_model), intent(inout) :: self
    integer, intent(in) :: k                !! place
    real(wp), intent(in) :: force(2)        !! [N]
    real(wp), intent(in) :: moment          !! [N m]
    integer :: b
    b = self%place_body(k)
    if (b == 0) return
    self%wrench(1, k) = self%wrench(1, k) + self%c(b)*force(1) + self%sn(b)*force(2)
    self%wrench(2, k) = self%wrench(2, k) - self%sn(b)*force(1) + self%c(b)*force(2)
    self%wrench(3, k) = self%wrench(3, k) + moment
  end subroutine add_wrench

  !> Wrenches on places act on the frames: A^T F, (H rho).A^T F + M.
  pure subroutine load_frames(self)
    type(mechanism_model), intent(inout) :: self
    integer :: j, k, b
    do j = 1, size(self%s%loaded)
      k = self%s%loaded(j)
      b = self%place_body(k)
      self%rhs(1:2, b) = self%rhs(1:2, b) + self%wrench(1:2, k)
      self%rhs(3, b) = self%rhs(3, b) + self%wrench(3, k) + self%p%rho(1, k)*self%wrench(2, k) &
                       - self%p%rho(2, k)*self%wrench(1, k)
    end do
  end subroutine load_frames

  !> Wrenches on places act on the elastic coordinates there.
  pure subroutine load_elastic(self, b)
    type(mechanism_model), intent(inout) :: self
    integer, intent(in) :: b
    integer :: j, k, c, i
    do j = self%s%loaded_first(b), self%s%loaded_first(b + 1) - 1
      k = self%s%loaded(j)
      associate (place => self%s%places(k), bo => self%s%bodies(b))
        if (allocated(place%psi)) then
          do i = 1, bo%nf
            bo%fx(i) = bo%fx(i) + dot_product(place%psi(:, i), self%wrench(:, k))
          end do
        else
          do c = 1, 3
            i = place%dof(c)
            if (i > 0) bo%fx(i) = bo%fx(i) + self%wrench(c, k)
          end do
        end if
      end associate
    end do
  end subroutine load_elastic
end module place_forces
