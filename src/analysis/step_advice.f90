!> Which explicit step is stable, what limits it and what removing that would buy (theory.md, section 8). Safe bound: joints
!> and drives released, for the whole run of linear bodies. Current bound: the constrained mechanism as it stands.
module step_advice
  use kinds, only: wp
  use assembly, only: assemble
  use assembly_reports, only: assembly_report
  use build_scene, only: build
  use deck_records, only: deck
  use dynamics, only: evaluate
  use errors, only: failure, fault_list
  use mechanism, only: mechanism_model
  use mechanism_setup, only: set_up_mechanism
  use scene_model, only: scene
  use spectrum, only: fast_spectrum
  use stability_region, only: method_names
  use step_bounds, only: step_bound, find_bound, find_safe_bound, take_smaller
  use text, only: es_text, fixed_text, to_text
  implicit none (type, external)
  private
  public :: advise, stability_advice

  !> Both bounds and their explanation, for the summary.
  type :: stability_advice
    type(step_bound) :: safe, current
    character(:), allocatable :: text
  end type stability_advice

contains

  !> Both bounds at the present state, with their explanation.
  subroutine advise(d, m, q, advice)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)               !! (nq) the assembled positions
    type(stability_advice), intent(out) :: advice
    call both_bounds(d, m, q, advice%safe, advice%current)
    call advice_lines(d, m, advice)
  end subroutine advise

  !> The safe bound and that of the mechanism as it stands, which the former never exceeds: joints may keep a mode from what
  !> damps it.
  subroutine both_bounds(d, m, q, safe, current)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    real(wp), intent(in) :: q(:)               !! (nq) the assembled positions [m], [rad]
    type(step_bound), intent(out) :: safe, current
    type(mechanism_model) :: work
    type(fast_spectrum) :: fast
    real(wp), allocatable :: rest(:), none(:)
    work = m
    allocate (rest(size(q)), none(m%s%nz), source=0.0_wp)
    call evaluate(work, 0.0_wp, q, rest, none, none)
    call fast%set_up(work, q)
    call find_safe_bound(d, work, fast, safe)
    call evaluate(work, 0.0_wp, q, rest, none, none)
    call find_bound(d, work, .true., fast, current)
    call take_smaller(current, safe)
  end subroutine both_bounds

  !> The advice in words: bounds, what limits, what removing it buys.
  subroutine advice_lines(d, m, advice)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    type(stability_advice), intent(inout) :: advice
    integer :: k
    advice%text = 'stable steps of explicit methods'//new_line('a')
    do k = 1, size(method_names)
      if (advice%safe%step(k) >= huge(1.0_wp)) then
        advice%text = advice%text//'  '//trim(method_names(k))//': no limit (nothing vibrates or decays fast): accuracy '// &
                      'alone sets the step'//new_line('a')
        cycle
      end if
      advice%text = advice%text//'  '//trim(method_names(k))//': safe bound '//es_text(advice%safe%step(k), 4)// &
                    ' s (joints released)'
      if (advice%current%step(k) > 1.0e6_wp*advice%safe%step(k)) then
        advice%text = advice%text//', no current bound (as assembled)'//new_line('a')
      else
        advice%text = advice%text//', current bound '//es_text(advice%current%step(k), 4)//' s (as assembled)'//new_line('a')
      end if
      advice%text = advice%text//'    limited by '//trim(advice%safe%cause(k)%what)//', |eigenvalue| '// &
                    es_text(abs(advice%safe%mu(k)), 4)//' rad/s, damping ratio '// &
                    fixed_text(abs(real(advice%safe%mu(k), wp))/abs(advice%safe%mu(k)), 4)//new_line('a')
    end do
    if (any(m%s%bodies%stiffening)) advice%text = advice%text//'  note: with geometric stiffening the bounds are those '// &
                                                  'of the start; tension raises frequencies'//new_line('a')
    if (advice%safe%step(1) < huge(1.0_wp)) call what_helps(d, advice)
  end subroutine advice_lines

  !> Rebuilds the scene without what limits, and says the bound that remains.
  subroutine what_helps(d, advice)
    type(deck), intent(in) :: d
    type(stability_advice), intent(inout) :: advice
    type(deck) :: other
    character(:), allocatable :: number
    integer :: b
    b = advice%safe%cause(1)%body
    if (advice%safe%cause(1)%run > 0) then
      if (advice%safe%cause(1)%material > 0 .and. b > 0) then
        other = d
        other%bodies(b)%viscoelastic = .false.
        call try('    without GHM in body "'//trim(d%bodies(b)%name)//'"', other, advice)
      end if
      return
    end if
    if (b == 0) return
    if (d%bodies(b)%kind == 'beam' .and. d%bodies(b)%axial .and. .not. d%bodies(b)%stiffening) then
      other = d
      other%bodies(b)%axial = .false.
      call try('    with axial=.false. on body "'//trim(d%bodies(b)%name)//'"', other, advice)
    end if
    if (d%bodies(b)%kind == 'beam' .and. d%bodies(b)%elements > 1 .and. d%bodies(b)%modes == 0) then
      other = d
      call halve_elements(other, b)
      number = to_text(other%bodies(b)%elements)//trim(merge(' element ', ' elements', other%bodies(b)%elements == 1))
      call try('    with '//number//' on body "'//trim(d%bodies(b)%name)//'"', other, advice)
    end if
    if (d%bodies(b)%modes == 0 .and. .not. d%bodies(b)%stiffening) then
      other = d
      other%bodies(b)%modes = 2
      call try('    with modes=2 on body "'//trim(d%bodies(b)%name)//'"', other, advice)
    end if
    other = d
    other%bodies(b)%flexible = .false.
    call try('    with body "'//trim(d%bodies(b)%name)//'" rigid', other, advice)
  end subroutine what_helps

  !> Half the elements of a beam; lumps and places keep to nodes that remain, so only ends are sure: others make it void.
  subroutine halve_elements(d, b)
    type(deck), intent(inout) :: d
    integer, intent(in) :: b
    integer :: n, k
    n = d%bodies(b)%elements
    d%bodies(b)%elements = (n + 1)/2
    d%bodies(b)%nodes = d%bodies(b)%elements + 1
    d%bodies(b)%element_material = d%bodies(b)%element_material(1:d%bodies(b)%elements)
    d%bodies(b)%element_section = d%bodies(b)%element_section(1:d%bodies(b)%elements)
    if (d%bodies(b)%reference == 'explicit') then
      do k = 1, size(d%bodies(b)%reference_node)
        call move(b, d%bodies(b)%reference_node(k))
      end do
    end if
    do k = 1, size(d%lumps)
      call move(d%lumps(k)%place%body, d%lumps(k)%place%node)
    end do
    do k = 1, size(d%joints)
      call move(d%joints(k)%a%body, d%joints(k)%a%node)
      call move(d%joints(k)%b%body, d%joints(k)%b%node)
    end do
    do k = 1, size(d%drives)
      call move(d%drives(k)%a%body, d%drives(k)%a%node)
      call move(d%drives(k)%b%body, d%drives(k)%b%node)
    end do
    do k = 1, size(d%springs)
      call move(d%springs(k)%a%body, d%springs(k)%a%node)
      call move(d%springs(k)%b%body, d%springs(k)%b%node)
    end do
    do k = 1, size(d%forces)
      call move(d%forces(k)%place%body, d%forces(k)%place%node)
    end do
    deallocate (d%sensors)
    allocate (d%sensors(0))
  contains
    !> The node of the coarser mesh nearest to one of the finer.
    subroutine move(body, node)
      integer, intent(in) :: body
      integer, intent(inout) :: node
      if (body /= b .or. node == 0) return
      node = 1 + nint(real((node - 1)*((n + 1)/2), wp)/n)
    end subroutine move
  end subroutine halve_elements

  !> Adds a line with the bound of a changed deck.
  subroutine try(text, other, advice)
    character(*), intent(in) :: text
    type(deck), intent(in) :: other
    type(stability_advice), intent(inout) :: advice
    type(mechanism_model) :: m
    type(scene) :: s
    type(fault_list) :: faults
    type(assembly_report) :: report
    type(failure) :: fail
    type(step_bound) :: bound, current
    real(wp), allocatable :: q(:), v(:)
    call build(other, s, faults)
    if (faults%count > 0) return
    call set_up_mechanism(m, s)
    allocate (q(s%nq), v(s%nq))
    call assemble(m, q, v, report, fail)
    if (fail%happened()) return
    call both_bounds(other, m, q, bound, current)
    if (bound%step(1) >= huge(1.0_wp)) then
      advice%text = advice%text//text//': no limit'//new_line('a')
    else
      advice%text = advice%text//text//': '//es_text(bound%step(1), 4)//' s (rk4), '// &
                    fixed_text(bound%step(1)/advice%safe%step(1), 2)//' times'//new_line('a')
    end if
  end subroutine try
end module step_advice
