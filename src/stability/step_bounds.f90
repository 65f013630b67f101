!> Bounds of explicit steps from the fast end of the spectrum: eigenvalues of the fastest modes with their damping and
!> viscoelastic terms, and the terms' own poles, put into each method's stability region (theory.md, section 8).
module step_bounds
  use kinds, only: wp
  use linear_matrices, only: linear_segment
  use bound_causes, only: bound_cause, mode_cause, pole_cause, name_damping
  use fast_poles, only: pole_list, find_fast_poles
  use modal_eigenvalues, only: modal_roots, find_mode_pair, term_poles, added_stiffness
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use spectrum, only: fast_spectrum, fast_mode, only_stiffness
  use stability_region, only: largest_step
  use tableaux, only: method_names
  implicit none (type, external)
  private
  public :: step_bound, find_bound, take_smaller, material_poles, add_mode_bound, step_of

  !> A bound for each explicit method and what sets it.
  type :: step_bound
    real(wp) :: step(size(method_names)) = huge(1.0_wp)   !! [s]
    complex(wp) :: mu(size(method_names)) = 0.0_wp        !! the limiting eigenvalue [1/s]
    type(bound_cause) :: cause(size(method_names))        !! what it belongs to
  end type step_bound

  integer, parameter :: modes_examined = 6         !! fastest modes that are examined where too many laws take part in each

contains

  !> Keeps the smaller bound of each method.
  pure subroutine take_smaller(other, bound)
    type(step_bound), intent(in) :: other
    type(step_bound), intent(inout) :: bound
    integer :: k
    do k = 1, size(method_names)
      if (other%step(k) >= bound%step(k)*(1 - 1.0e-9_wp)) cycle
      bound%step(k) = other%step(k)
      bound%mu(k) = other%mu(k)
      bound%cause(k) = other%cause(k)
    end do
  end subroutine take_smaller

  !> Bound at an evaluated state of a mechanism, with or without joints.
  subroutine find_bound(m, ev, with_joints, fast, bound)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: with_joints
    type(fast_spectrum), intent(inout) :: fast !! set up
    type(step_bound), intent(out) :: bound
    type(fast_mode) :: f
    type(bound_cause) :: cause
    type(pole_list) :: poles
    real(wp) :: fastest                        ! [rad2/s2]
    integer :: k
    logical :: damped
    if (with_joints) call fast%take_present_springs(m, ev)
    call fast%largest(m, ev, with_joints, only_stiffness, 100, fastest)
    damped = fast%damped .or. size(fast%lin%segments) > 0 .or. (with_joints .and. fast%loops)
    if (damped) then
      call find_fast_poles(m, ev, with_joints, fast, poles, damped)
      do k = 1, merge(size(poles%lambda), 0, damped)
        call add_pole_bound(m, ev, fast, poles%lambda(k), poles%x(:, k), bound)
      end do
    end if
    do k = 1, merge(0, min(modes_examined, fast%steps), damped)
      if (fast%e(fast%steps + 1 - k) < 0.25_wp*fastest) exit
      call fast%mode(m, ev, k, f)
      call mode_cause(m, f, cause)
      call add_mode_bound(m, fast, f, cause, bound)
    end do
    call material_poles(m, ev, with_joints, fast, fastest, bound)
  end subroutine find_bound

  !> One pole of the mechanism with its motion, where it lowers a bound.
  subroutine add_pole_bound(m, ev, fast, mu, x, bound)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(fast_spectrum), intent(in) :: fast
    complex(wp), intent(in) :: mu              !! [1/s]
    real(wp), intent(in) :: x(:)               !! (n) its motion, of unit modal mass [1/sqrt(kg)]
    type(step_bound), intent(inout) :: bound
    type(fast_mode) :: f
    type(bound_cause) :: cause
    integer :: k
    if (all([(largest_step(k, mu, bound%step(k)) >= bound%step(k), k=1, size(method_names))])) return
    f%x = x
    call fast%quotients(m, ev, f)
    call mode_cause(m, f, cause)
    call add_mode_bound(m, fast, f, cause, bound, [mu])
  end subroutine add_pole_bound

  !> The bound of one mode: of the roots of s2 + c s + k + sum of k_r alpha h(s), or of the given poles of the mechanism.
  subroutine add_mode_bound(m, fast, f, carrier, bound, poles)
    type(mechanism_model), intent(in) :: m
    type(fast_spectrum), intent(in) :: fast
    type(fast_mode), intent(in) :: f
    type(bound_cause), intent(in) :: carrier   !! what the mode belongs to
    type(step_bound), intent(inout) :: bound
    complex(wp), intent(in), optional :: poles(:)   !! [1/s]
    complex(wp), allocatable :: roots(:), eigenvalues(:) ! [1/s]
    logical, allocatable :: is_mode(:)
    type(bound_cause) :: cause
    integer :: k
    call modal_roots(fast%lin%segments, f%stiffness, f%damping, f%segments, 1.0e-6_wp*(f%stiffness + sum(f%segments)), roots)
    call find_mode_pair(roots, max(f%stiffness + added_stiffness(fast%lin%segments, f%segments), 0.0_wp), f%damping, is_mode)
    eigenvalues = roots
    if (present(poles)) eigenvalues = poles
    is_mode = [(is_mode(minloc(abs(roots - eigenvalues(k)), 1)), k=1, size(eigenvalues))]
    cause = carrier
    if (damping_limits(fast, f, eigenvalues)) call name_damping(f, f%springs, cause)
    call keep_smallest(pack(eigenvalues, is_mode), cause, bound)
    if (all(is_mode)) return
    cause = pole_cause(m, fast%lin%segments, maxloc(f%segments, dim=1))
    cause%body = carrier%body
    call keep_smallest(pack(eigenvalues, .not. is_mode), cause, bound)
  end subroutine add_mode_bound

  !> Whether a mode would allow larger steps of rk4 without its damping.
  logical function damping_limits(fast, f, roots) result(yes)
    type(fast_spectrum), intent(in) :: fast
    type(fast_mode), intent(in) :: f
    complex(wp), intent(in) :: roots(:)        !! with damping [1/s]
    complex(wp), allocatable :: without(:)     ! [1/s]
    yes = f%damping > 0.0_wp
    if (.not. yes) return
    call modal_roots(fast%lin%segments, f%stiffness, 0.0_wp, f%segments, 1.0e-6_wp*(f%stiffness + sum(f%segments)), without)
    yes = step_of(1, roots) < 0.99_wp*step_of(1, without)
  end function damping_limits

  !> Largest step of a method that all of the roots allow [s]; huge where none bounds it.
  pure real(wp) function step_of(method, roots) result(h)   ! [s]
    integer, intent(in) :: method              !! number in method_names
    complex(wp), intent(in) :: roots(:)        !! [1/s]
    integer :: i
    h = huge(1.0_wp)
    do i = 1, size(roots)
      h = min(h, largest_step(method, roots(i), h))
    end do
  end function step_of

  !> Keeps the smallest step of every method.
  subroutine keep_smallest(roots, cause, bound)
    complex(wp), intent(in) :: roots(:)        !! [1/s]
    type(bound_cause), intent(in) :: cause     !! what they belong to
    type(step_bound), intent(inout) :: bound
    real(wp) :: h
    integer :: k, i
    do k = 1, size(method_names)
      do i = 1, size(roots)
        h = largest_step(k, roots(i), bound%step(k))
        if (h >= bound%step(k)*(1 - 1.0e-9_wp)) cycle
        bound%step(k) = h
        bound%mu(k) = roots(i)
        bound%cause(k) = cause
      end do
    end do
  end subroutine keep_smallest

  !> Poles of the terms of every material and spring lie between two limits, and both are examined:
  !> - the terms' own poles, which those of slow modes approach;
  !> - the poles of the fastest motion that this material or spring alone holds. They are computed only where they can set the
  !>   bound, since that motion is slower than the fastest of the mechanism.
  subroutine material_poles(m, ev, with_joints, fast, fastest, bound)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    logical, intent(in) :: with_joints
    type(fast_spectrum), intent(inout) :: fast
    real(wp), intent(in) :: fastest            !! largest squared frequency, instantaneous stiffness [rad2/s2]
    type(step_bound), intent(inout) :: bound
    complex(wp), allocatable :: roots(:)
    integer, allocatable :: firsts(:)          ! one segment of each material or spring
    real(wp), allocatable :: least(:, :)       ! (methods, firsts) steps that no pole of these makes smaller [s]
    real(wp) :: lambda
    integer :: i, k
    firsts = distinct_segments(fast%lin%segments)
    allocate (least(size(method_names), size(firsts)))
    do i = 1, size(firsts)
      associate (t => fast%lin%segments(firsts(i)))
        call keep_smallest(t%law%rates(), pole_cause(m, fast%lin%segments, firsts(i)), bound)
        call term_poles(t, 2*fastest/(1 + sum(t%law%alpha)), roots)
        least(:, i) = [(step_of(k, roots), k=1, size(method_names))]
      end associate
    end do
    do i = 1 - size(method_names), size(firsts)          ! first the segment that limits each method most
      k = i
      if (i < 1) k = minloc(least(1 - i, :), 1)
      if (k == 0) cycle
      if (all(least(:, k) >= bound%step)) cycle
      call fast%largest(m, ev, with_joints, only_stiffness, 100, lambda, firsts(k))
      least(:, k) = huge(1.0_wp)
      if (.not. lambda > 0.0_wp) cycle
      call term_poles(fast%lin%segments(firsts(k)), lambda, roots)
      call keep_smallest(roots, pole_cause(m, fast%lin%segments, firsts(k)), bound)
    end do
  end subroutine material_poles

  !> The springs' segments and the first segment of every material.
  pure function distinct_segments(segments) result(firsts)
    type(linear_segment), intent(in) :: segments(:)
    integer, allocatable :: firsts(:)
    logical :: seen(0:maxval([0, segments%material]))
    logical :: new(size(segments))
    integer :: r
    seen = .false.
    do r = 1, size(segments)
      new(r) = segments(r)%element > 0 .or. .not. seen(segments(r)%material)
      seen(segments(r)%material) = .true.
    end do
    firsts = pack([(r, r=1, size(segments))], new)
  end function distinct_segments
end module step_bounds
