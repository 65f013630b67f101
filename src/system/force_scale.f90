!> The largest force that acts anywhere in an evaluated mechanism: what a residual is small against.
module force_scale
  use kinds, only: wp
  use body, only: body_model
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use nodal_basis, only: element_stress
  implicit none (type, external)
  private
  public :: largest_force

contains

  !> Loads and springs, weights and inertia forces, joint forces, element forces; moments over the size [N].
  pure real(wp) function largest_force(m, ev) result(force)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(in) :: ev
    integer :: b, k
    force = 0.0_wp
    do k = 1, size(m%s%markers)
      force = max(force, norm2(ev%wrench(1:2, k)), abs(ev%wrench(3, k))/m%s%size)
    end do
    do b = 1, size(m%s%bodies)
      force = max(force, m%s%bodies(b)%mass*norm2(ev%options%gravity), norm2(ev%frame%rhs(1:2, b)))
      force = max(force, element_force(m%s%bodies(b)))
    end do
    if (m%s%rows > 0) force = max(force, maxval(abs(ev%lambda)))
  end function largest_force

  !> Largest axial force or end moment over length of a body's elements [N].
  pure real(wp) function element_force(b) result(force)
    type(body_model), intent(in) :: b
    real(wp) :: n, fpsi, m1, m2
    integer :: e
    force = 0.0_wp
    if (.not. b%flexible) return
    if (b%modal) then
      force = maxval(abs(b%omega2*b%qx(1:b%nf)))*sqrt(b%mass)
      return
    end if
    do e = 1, b%ne
      call element_stress(b, e, b%d(:, e), b%d(:, e), n, fpsi, m1, m2)
      force = max(force, abs(n), abs(m1 + m2)/b%elements(e)%length)
    end do
  end function element_force
end module force_scale
