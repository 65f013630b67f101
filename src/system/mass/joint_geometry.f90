!> The joints' geometry apart from the masses: G = Phi_q W^-1 Phi_q^T with a metric W that knows lengths only. Frames weigh
!> one in translation. In rotation they weigh the square of a radius: the distance of the body's farthest joint from the middle of
!> its joints. Elastic coordinates of nodes weigh the same, without coupling; modes keep their compliances per unit of the body's
!> mass. G is singular where rows depend on others, whatever the masses are. So it separates redundant joints and singular positions
!> from heavy bodies on light links (multipliers). It is summed only where the multipliers' matrix has a weak pivot.
module joint_geometry
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model, flexible_attachments
  implicit none (type, external)
  private
  public :: condense_geometry, factor_joints

contains

  !> Factors the multipliers' matrix of the last evaluation; where a pivot is weak, the geometry says what that means.
  subroutine factor_joints(self, ev, accept_weak_pivots)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: accept_weak_pivots     !! factors the matrix as it is, as long as its pivots are not 0 by rounding
    logical :: good
    call ev%schur%factor_strong(good)
    if (good) return
    call condense_geometry(self, ev)
    call ev%schur%factor_weak(accept_weak_pivots)
  end subroutine factor_joints

  !> Sums G from the unit wrenches of the last evaluation, body by body.
  subroutine condense_geometry(self, ev)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    real(wp) :: middle(2), radius
    integer :: b
    ev%schur%g = 0.0_wp
    do b = 1, size(ev%frame%cos)
      if (self%incidence%first(b + 1) == self%incidence%first(b)) cycle
      call extent(self, ev, b, middle, radius)
      call add_frame(self, ev, b, middle, radius)
      if (self%flexible(b) .and. .not. ev%elastic_held) call add_elastic(self, ev, b, self%attached(b), radius)
    end do
  end subroutine condense_geometry

  !> The middle of a body's joints and how far they lie from it.
  pure subroutine extent(self, ev, b, middle, radius)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(in) :: ev
    integer, intent(in) :: b
    real(wp), intent(out) :: middle(2)            !! body axes [m]
    real(wp), intent(out) :: radius                !! [m]
    integer :: e
    middle = 0.0_wp
    do e = self%incidence%first(b), self%incidence%first(b + 1) - 1
      middle = middle + ev%p%rho(:, self%incidence%marker(e))
    end do
    middle = middle/(self%incidence%first(b + 1) - self%incidence%first(b))
    radius = 0.0_wp
    do e = self%incidence%first(b), self%incidence%first(b + 1) - 1
      radius = max(radius, norm2(ev%p%rho(:, self%incidence%marker(e)) - middle))
    end do
    if (.not. radius > 1.0e-9_wp*norm2(middle)) radius = max(norm2(middle), self%s%size)    ! one place alone
  end subroutine extent

  !> What the frame's motion adds: wrenches about the middle of the joints.
  pure subroutine add_frame(self, ev, b, middle, radius)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: b
    real(wp), intent(in) :: middle(2), radius      !! [m]
    real(wp) :: we(3), wf(3)
    integer :: e, f
    do e = self%incidence%first(b), self%incidence%first(b + 1) - 1
      we = about(ev%side%w(:, e), ev%p%rho(:, self%incidence%marker(e)) - middle, radius)
      do f = self%incidence%first(b), e
        wf = about(ev%side%w(:, f), ev%p%rho(:, self%incidence%marker(f)) - middle, radius)
        call add_pair(self, ev, e, f, dot_product(we, wf))
      end do
    end do
  end subroutine add_frame

  !> A wrench on a marker as force, and moment about the middle over the radius.
  pure function about(w, arm, radius) result(x)
    real(wp), intent(in) :: w(3)                  !! wrench, body axes [-, m]
    real(wp), intent(in) :: arm(2), radius         !! [m]
    real(wp) :: x(3)
    x(1:2) = w(1:2)
    x(3) = (w(3) + arm(1)*w(2) - arm(2)*w(1))/radius
  end function about

  !> What the elastic coordinates of the markers add.
  pure subroutine add_elastic(self, ev, b, at, radius)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: b
    type(flexible_attachments), intent(in) :: at
    real(wp), intent(in) :: radius                 !! [m]
    real(wp) :: unit(3), x
    integer :: e, f, i, j, c
    logical :: same
    unit = [1.0_wp, 1.0_wp, 1.0_wp/radius**2]
    do e = self%incidence%first(b), self%incidence%first(b + 1) - 1
      i = self%incidence%attachment(e)
      do f = self%incidence%first(b), e
        j = self%incidence%attachment(f)
        x = 0.0_wp
        do c = 1, 3
          same = self%s%markers(at%marker(i))%dof(c) == self%s%markers(at%marker(j))%dof(c) .and. at%column(c, i) > 0
          if (allocated(self%s%markers(at%marker(i))%psi)) then
            x = x + self%s%bodies(b)%mass*ev%side%w(c, f)*dot_product(ev%side%w(:, e), at%compliance(:, c, i, j))
          else if (same) then
            x = x + unit(c)*ev%side%w(c, e)*ev%side%w(c, f)
          end if
        end do
        call add_pair(self, ev, e, f, x)
      end do
    end do
  end subroutine add_elastic

  !> Adds to the entry of two sides' rows, scaled as S is.
  pure subroutine add_pair(self, ev, e, f, x)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: e, f
    real(wp), intent(in) :: x                     !! [-]
    real(wp) :: y
    integer :: i, j
    associate (s => ev%schur)
      i = s%position(self%incidence%row(e))
      j = s%position(self%incidence%row(f))
      y = x*s%scale(self%incidence%row(e))*s%scale(self%incidence%row(f))
      if (i == j .and. f < e) y = 2*y             ! both markers of one row on the same body
      s%g(abs(i - j), min(i, j)) = s%g(abs(i - j), min(i, j)) + y
    end associate
  end subroutine add_pair
end module joint_geometry
