!> The largest force that acts anywhere in an evaluated mechanism: the measure of residuals.
module force_scale
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
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
      associate (body => m%s%bodies(b))
        if (body%flexible) force = max(force, body%basis%largest_force(body, ev%elastic(b)))
      end associate
    end do
    if (m%s%rows > 0) force = max(force, maxval(abs(ev%lambda)))
  end function largest_force
end module force_scale
