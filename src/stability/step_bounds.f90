!> Bounds of explicit steps from the fast end of the spectrum: eigenvalues of the fastest modes with their damping and
!> viscoelastic terms, and the terms' own poles, put into each method's stability region (theory.md, section 8). The cause of a
!> bound: body and strain of a fast mode, material or spring of a viscoelastic pole, or the loop of a controller.
module step_bounds
  use kinds, only: wp
  use linear_matrices, only: linear_segment
  use fast_poles, only: pole_list, find_fast_poles
  use modal_eigenvalues, only: modal_roots, find_mode_pair, term_poles, added_stiffness
  use evaluation_results, only: evaluation
  use mechanism, only: mechanism_model
  use spectrum, only: fast_spectrum, fast_mode, only_stiffness
  use stability_region, only: largest_step
  use tableaux, only: method_names
  use text, only: either, to_text
  implicit none (type, external)
  private
  public :: bound_cause, mode_cause, step_bound, find_bound, take_smaller, material_poles, add_mode_bound, step_of, windup_poles

  real(wp), parameter :: noticed = 0.01_wp       !! smallest part of a step that what limits it costs [-]
  real(wp), parameter :: takes_part = epsilon(1.0_wp)**0.25_wp   !! share of a mode's strain energy from which a body is named [-]

  !> Cause of an eigenvalue.
  type :: bound_cause
    character(:), allocatable :: what              !! in words
    integer :: body = 0                      !! body that carries the mode or has the material, 0: none
    integer :: segment = 0                   !! segment of the internal variable, 0: a mode
    logical :: rayleigh = .false.            !! Rayleigh damping of the body sets it
    integer :: material = 0                  !! material of that segment, 0: none, or a spring's terms
    integer :: controller = 0                !! controller whose loop it is, 0: none
  end type bound_cause

  character(18), parameter :: strains(3) = [character(18) :: 'an axial mode', 'a bending mode', 'slip of the layers']

  !> A bound for each explicit method and what sets it.
  type :: step_bound
    real(wp) :: step(size(method_names)) = huge(1.0_wp)   !! [s]
    complex(wp) :: mu(size(method_names)) = 0.0_wp        !! the limiting eigenvalue [1/s]
    type(bound_cause) :: cause(size(method_names))        !! what it belongs to
    real(wp) :: growth = 0.0_wp                           !! of the motion that grows fastest, 0: none is known to grow [1/s]
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
      bound%growth = poles%growth
      do k = 1, merge(size(poles%lambda), 0, damped)
        call add_pole_bound(m, ev, fast, poles, k, bound)
      end do
    end if
    do k = 1, merge(0, min(modes_examined, fast%steps), damped)
      if (fast%e(fast%steps + 1 - k) < 0.25_wp*fastest) exit
      call fast%mode(m, ev, k, f)
      call mode_cause(m, f, cause)
      call add_mode_bound(m, fast, f, cause, bound)
    end do
    call material_poles(m, ev, with_joints, fast, fastest, bound)
    if (with_joints) call windup_poles(m, ev%control%limited /= 0, bound)
  end subroutine find_bound

  !> Controllers at a limit: the integral follows the output with a pole of its own.
  subroutine windup_poles(m, limited, bound)
    type(mechanism_model), intent(in) :: m
    logical, intent(in) :: limited(:)          !! (controllers) it is at a limit, or the motion may lead there
    type(step_bound), intent(inout) :: bound
    type(bound_cause) :: cause
    integer :: k
    do k = 1, size(m%s%controllers)
      associate (c => m%s%controllers(k))
        if (.not. (limited(k) .and. c%winds_back())) cycle
        cause%what = 'the windup of controller "'//trim(c%name)//'" while its output is at a limit'
        cause%controller = k
        call keep_smallest([cmplx(-1/c%windup_time, 0.0_wp, wp)], cause, bound)
      end associate
    end do
  end subroutine windup_poles

  !> One pole of the mechanism with its motion, where it lowers a bound. It is a loop's where open loops would allow larger steps.
  subroutine add_pole_bound(m, ev, fast, poles, pole, bound)
    type(mechanism_model), intent(in) :: m
    type(evaluation), intent(inout) :: ev
    type(fast_spectrum), intent(in) :: fast
    type(pole_list), intent(in) :: poles
    integer, intent(in) :: pole                !! its number
    type(step_bound), intent(inout) :: bound
    type(fast_mode) :: f
    type(bound_cause) :: cause
    integer :: k
    associate (mu => poles%lambda(pole), c => poles%controller(pole))
      if (all([(largest_step(k, mu, bound%step(k)) >= bound%step(k), k=1, size(method_names))])) return
      if (c > 0 .and. any([(step_of(k, [mu]) < (1 - noticed)*step_of(k, poles%open), k=1, size(method_names))])) then
        cause%what = 'the loop of controller "'//trim(m%s%controllers(c)%name)//'"'
        cause%controller = c
        call keep_smallest([mu], cause, bound)
        return
      end if
      f%x = poles%x(:, pole)
      call fast%quotients(m, ev, f)
      call mode_cause(m, f, cause)
      call add_mode_bound(m, fast, f, cause, bound, [mu])
    end associate
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
    call modal_roots(fast%lin%segments, f%stiffness, f%damping, f%segments, roots)
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
    call modal_roots(fast%lin%segments, f%stiffness, 0.0_wp, f%segments, without)
    yes = step_of(1, roots) < (1 - noticed)*step_of(1, without)
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
    logical :: seen(0:maxval([0, fast%lin%segments%material]))   ! materials of segments before
    real(wp) :: lambda
    integer :: r, k
    seen = .false.
    do r = 1, size(fast%lin%segments)
      associate (t => fast%lin%segments(r))
        if (t%element == 0 .and. seen(t%material)) cycle
        seen(t%material) = .true.
        call keep_smallest(t%law%rates(), pole_cause(m, fast%lin%segments, r), bound)
        call term_poles(t, 2*fastest/(1 + sum(t%law%alpha)), roots)
        if (all([(step_of(k, roots), k=1, size(method_names))] >= bound%step)) cycle
        call fast%largest(m, ev, with_joints, only_stiffness, 100, lambda, r)
        if (.not. lambda > 0.0_wp) cycle
        call term_poles(t, lambda, roots)
        call keep_smallest(roots, pole_cause(m, fast%lin%segments, r), bound)
      end associate
    end do
  end subroutine material_poles

  !> Which body carries a mode, and whether its strain is axial, in bending or of layers that slip.
  subroutine mode_cause(m, f, cause)
    type(mechanism_model), intent(in) :: m
    type(fast_mode), intent(in) :: f
    type(bound_cause), intent(out) :: cause
    real(wp) :: best, strained, parts(3)      ! [1/s2]
    integer :: b, i, largest
    best = 0.0_wp
    strained = 0.0_wp
    largest = 1
    do b = 1, size(m%s%bodies)
      i = m%s%qo(b) + 3
      associate (body => m%s%bodies(b))
        if (.not. body%flexible) cycle
        parts = body%basis%strain_parts(body, f%x(i + 1:i + body%nf))
        strained = strained + sum(parts)
        if (sum(parts) <= best) cycle
        best = sum(parts)
        cause%body = b
        largest = maxloc(parts, 1, back=.true.)
      end associate
    end do
    if (cause%body == 0 .or. strained < 0.5_wp*abs(f%stiffness)) then
      cause%what = 'a mode of springs and rigid bodies'
      if (best > takes_part*abs(f%stiffness)) cause%what = 'a mode of springs with body "'//trim(m%s%bodies(cause%body)%name)//'"'
      cause%body = 0
    else
      cause%what = trim(strains(largest))//' of body "'//trim(m%s%bodies(cause%body)%name)//'"'
    end if
  end subroutine mode_cause

  !> Names damping as the cause: that of the body's material, or of springs.
  pure subroutine name_damping(f, spring_part, cause)
    type(fast_mode), intent(in) :: f
    real(wp), intent(in) :: spring_part      !! of the mode's damping [1/s]
    type(bound_cause), intent(inout) :: cause
    associate (by_material => spring_part < 0.5_wp*f%damping)
      cause%rayleigh = cause%body > 0 .and. by_material
      cause%what = either('Rayleigh damping of', 'dampers on', by_material)//' '//cause%what
    end associate
  end subroutine name_damping

  !> The material or spring of a segment's poles, with the number of its fastest term.
  function pole_cause(m, segments, r) result(cause)
    type(mechanism_model), intent(in) :: m
    type(linear_segment), intent(in) :: segments(:)
    integer, intent(in) :: r                 !! segment
    type(bound_cause) :: cause
    character(:), allocatable :: name         ! of the term
    integer :: term
    associate (t => segments(r))
      cause%body = t%body
      cause%segment = r
      cause%material = t%material
      term = maxloc(abs(t%law%rates()), dim=1)
      name = trim(t%law%words(term))
      if (term > t%law%second) term = term - t%law%second
      if (t%element > 0) then
        associate (f => m%s%forces(t%element)%item)
          cause%what = name//' pole of '//trim(f%group)//' "'//trim(f%name)//'", term '//to_text(term)
        end associate
      else
        cause%what = name//' pole of material "'//trim(m%s%materials(t%material))//'", term '//to_text(term)
      end if
    end associate
  end function pole_cause
end module step_bounds
