!> The joints' geometry apart from the masses: G = Phi_q W^-1 Phi_q^T with a metric W that knows lengths only. Frames weigh
!> one in translation. In rotation they weigh the square of a radius: the distance of the body's farthest joint from the middle of
!> its joints. Elastic coordinates of nodes weigh the same, without coupling; modes keep their compliances per unit of the body's
!> mass. G is singular where rows depend on others, whatever the masses are. So it separates redundant joints and singular positions
!> from heavy bodies on light links (multipliers). It is summed only where the multipliers' matrix has a weak pivot.
module joint_geometry
  use kinds, only: wp
  use evaluation_results, only: evaluation
  use joint_system, only: add_frame_compliance, rigid_wrenches
  use mechanism, only: mechanism_model, flexible_attachments
  implicit none (type, external)
  private
  public :: condense_geometry, factor_joints

contains

  !> Factors the multipliers' matrix of the last evaluation; where a pivot is weak, the geometry decides why.
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
    real(wp) :: l(3, size(ev%frame%cos)), dinv(3, size(ev%frame%cos))   ! factors of the frames' metrics [-, m], [-, 1/m2]
    real(wp) :: middle(2), radius
    integer :: b, n, pairs
    ev%schur%g = 0.0_wp
    l = 0.0_wp
    dinv = 0.0_wp
    pairs = 0
    associate (at => self%incidence)
      call rigid_wrenches(at%sides, at%marker, ev%side%w, size(self%markers%body), ev%p%rho, ev%side%rigid_wrench)
      do b = 1, size(ev%frame%cos)
        n = at%first(b + 1) - at%first(b)
        if (n == 0) cycle
        call extent(self, ev, b, middle, radius)
        l(:, b) = [0.0_wp, -middle(2), middle(1)]
        dinv(:, b) = [1.0_wp, 1.0_wp, 1/radius**2]
        pairs = pairs + n*(n + 1)/2
        if (.not. self%flexible(b) .or. ev%elastic_fixed) cycle
        call add_elastic(self, ev, b, elastic_metric(self, b, self%attached(b), radius), pairs - n*(n + 1)/2)
      end do
      call add_frame_compliance(size(ev%frame%cos), at%first, at%sides, at%row, l, dinv, ev%side%rigid_wrench, ev%side%g, &
                                self%s%rows, ev%schur%scale, size(ev%schur%all%entry), ev%schur%all%entry, size(ev%schur%g), &
                                ev%schur%g)
      if (allocated(ev%rows%off)) call ev%schur%uncouple()
    end associate
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
    if (.not. radius > 1.0e-9_wp*norm2(middle)) radius = max(norm2(middle), self%s%size)    ! all joints in one point
  end subroutine extent

  !> Adds w_e . metric w_f of all pairs of sides of one body.
  pure subroutine add_elastic(self, ev, b, metric, before)
    type(mechanism_model), intent(in) :: self
    type(evaluation), intent(inout) :: ev
    integer, intent(in) :: b
    real(wp), intent(in) :: metric(:, :, :, :)    !! between its markers [-], [1/m], [1/m2]
    integer, intent(in) :: before                 !! pairs of the bodies before
    real(wp) :: x
    integer :: e, f, k
    k = before
    associate (at => self%incidence, s => ev%schur, w => ev%side%w)
      do e = at%first(b), at%first(b + 1) - 1
        do f = at%first(b), e
          k = k + 1
          x = dot_product(w(:, e), matmul(metric(:, :, at%attachment(e), at%attachment(f)), w(:, f)))
          x = x*s%scale(at%row(e))*s%scale(at%row(f))*merge(2, 1, s%all%entry(k) < 0)   ! both markers of one row on the same body
          associate (i => mod(abs(s%all%entry(k)) - 1, s%all%kd + 1), j => 1 + (abs(s%all%entry(k)) - 1)/(s%all%kd + 1))
            s%g(i, j) = s%g(i, j) + x
          end associate
        end do
      end do
    end associate
  end subroutine add_elastic

  !> The compliances between a body's markers that stand for those of its elastic coordinates.
  pure function elastic_metric(self, b, at, radius) result(x)
    type(mechanism_model), intent(in) :: self
    integer, intent(in) :: b
    type(flexible_attachments), intent(in) :: at
    real(wp), intent(in) :: radius                !! [m]
    real(wp) :: x(3, 3, size(at%marker), size(at%marker))   !! [-], [1/m], [1/m2]
    integer :: i, c
    if (self%s%bodies(b)%basis%reduced_from > 0) then
      x = self%s%bodies(b)%mass*at%compliance
      return
    end if
    x = 0.0_wp
    do i = 1, size(at%owner)                      ! nodes: each marker has its own, and no other moves with it
      c = at%component(i)
      x(c, c, at%owner(i), at%owner(i)) = merge(1/radius**2, 1.0_wp, c == 3)
    end do
  end function elastic_metric
end module joint_geometry
