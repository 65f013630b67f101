!> The model part of the summary and of --check: what was modelled and why, and what it costs.
module summary
  use kinds, only: wp, pi
  use assembly_reports, only: assembly_report
  use body, only: body_model
  use controller, only: delay_limit
  use deck_parts, only: law_record
  use deck_records, only: deck
  use deck_temperature, only: has_shift
  use mechanism, only: mechanism_model
  use summary_text, only: json_number, summary_record
  use readable_text, only: json_text, one_line
  use program_version, only: version
  use text, only: either, in_quotes, to_text
  implicit none (type, external)
  private
  public :: model_lines, temperature_lines, version, weak_frames

contains

  !> What was modelled: bodies and their coordinates, constraints, degrees of freedom, redundant joints.
  subroutine model_lines(d, m, report, text)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    type(assembly_report), intent(in) :: report
    type(summary_record), intent(inout) :: text
    integer :: k
    call text%member('version', json_text(version))
    call text%line('deck: {deck='//d%name//'}')
    if (len(d%scene%title) > 0) call text%words%add('title: '//one_line(d%scene%title)//new_line('a'))
    call text%member('title', json_text(d%scene%title))
    if (size(d%parameters) > 0) then
      call text%open('parameters', '{')
      call text%say('parameters:')
      do k = 1, size(d%parameters)
        call text%say(either('', ',', k == 1)//' '//trim(d%parameters(k)%name)//' = {'//trim(d%parameters(k)%name)//'}', &
                      d%parameters(k:k)%value)
      end do
      call text%line('')
      call text%close()
    end if
    call text%section('model', 'model')
    call text%open('bodies', '[')
    do k = 1, size(m%s%bodies)
      call body_line(m%s%bodies(k), k)
    end do
    call text%close()
    call temperature_lines(d, text)
    do k = 1, size(d%springs)
      associate (s => d%springs(k))
        if (s%thermal_resistance > 0.0_wp) call text%line('  spring "'//trim(s%name)//'", warmed by its losses in the cycle, '// &
          to_text(s%thermal_resistance)//' K/W from '//to_text(s%law%temperature)//' C')
      end associate
    end do
    associate (s => m%s, terms => m%s%nz - sum(m%s%controllers%states))
      call text%line('  coordinates: {frame_coordinates #} of frames + {elastic_coordinates #} elastic = {coordinates #}', &
                     [real(wp) :: 3*size(s%bodies), s%nq - 3*size(s%bodies), s%nq])
      call text%say('  dissipative coordinates: {dissipative_coordinates #}', [real(wp) :: terms])
      if (s%nzd < terms) call text%say(', of first order: {dissipative_coordinates_of_first_order #}', [real(wp) :: terms - s%nzd])
      call text%line('')
      if (size(s%controllers) > 0) call control_lines(m, text)
      call text%line('  constraints (multipliers): {constraints #}, independent at the start: {independent_constraints #}', &
                     [real(wp) :: s%permanent_rows, report%rank])
      call text%line('  degrees of freedom: {degrees_of_freedom #}', [real(wp) :: report%freedoms])
      if (report%rank < s%permanent_rows) call text%line('  redundant constraints: {redundant_constraints #} at the start, '// &
        'among'//undetermined(m, report, size(report%dependent)), [real(wp) :: s%permanent_rows - report%rank])
    end associate
    call text%warn(model_warnings(d, m, report))
    call text%close()
  contains
    !> One body: which coordinates it has, and why.
    subroutine body_line(b, k)
      type(body_model), intent(in) :: b
      integer, intent(in) :: k
      character(:), allocatable :: words
      logical :: modal
      call text%open('', '{')
      if (.not. b%flexible) then
        words = '  body "{name='//trim(b%name)//'}": {model=rigid}, 3 coordinates'
        if (d%bodies(k)%kind /= 'rigid') words = words//' ('//trim(d%bodies(k)%kind)//' with flexible=.false.)'
        call text%line(words)
        call text%member('kind', json_text(trim(d%bodies(k)%kind)))
        call text%close()
        return
      end if
      modal = b%basis%reduced_from > 0
      call text%member('model', json_text(either('modal', 'nodal', modal)))
      call text%say('  body "{name='//trim(b%name)//'}": {kind='//trim(d%bodies(k)%kind)//'} of {elements #} elements, '// &
                    'reference {reference='//trim(d%bodies(k)%reference)//'}, 3 + {elastic_coordinates '// &
                                  '#}', [real(wp) :: b%ne, b%nf])
      if (modal) then
        words = ' modes'
        if (d%bodies(k)%static_shapes) words = words//', {static_shapes #} of them static shapes,'
        words = words//' of {nodal_coordinates #} nodal coordinates'
        if (.not. b%axial) words = words//', no axial deformation'
        call text%say(words, pack([real(wp) :: b%basis%static_shapes, b%basis%reduced_from], [d%bodies(k)%static_shapes, .true.]))
      else
        call text%say(' elastic coordinates ({nodal_coordinates #} nodal ones'// &
                      either('', ' without the axial ones', b%axial)//' less the reference conditions'// &
                      either(', {core_coordinates #} of cores)', ')', size(b%dof, 1) > 3), &
                      [real(wp) :: 3*b%nn, b%nf - count(b%dof(:3, :) > 0)])
      end if
      if (b%stiffening) call text%say(', geometric stiffening')
      if (d%bodies(k)%thermal_resistance > 0.0_wp) call text%say(', warmed by its '// &
        'losses in the cycle, {thermal_resistance} K/W from {ambient} C', [d%bodies(k)%thermal_resistance, d%bodies(k)%temperature])
      call text%member('dissipative_coordinates', to_text(b%nz))
      call text%word(', ', 'damping', damping_words(d, b, k))
      if (b%extra_references > 0) call text%say('; {extra_references #} reference conditions more than needed: stiffer than '// &
                                                'the structure', [real(wp) :: b%extra_references])
      call text%line('')
      call text%close()
    end subroutine body_line
  end subroutine model_lines

  !> What depends on a temperature, and how.
  subroutine temperature_lines(d, text)
    type(deck), intent(in) :: d
    type(summary_record), intent(inout) :: text
    integer :: k
    if (.not. (any(has_shift(d%materials%law)) .or. any(has_shift(d%springs%law)))) return
    call text%open('temperatures', '[')
    do k = 1, size(d%materials)
      if (has_shift(d%materials(k)%law)) call one_law('material', trim(d%materials(k)%label), 'modulus', d%materials(k)%law)
    end do
    do k = 1, size(d%springs)
      if (has_shift(d%springs(k)%law)) call one_law('spring', trim(d%springs(k)%name), 'stiffness', d%springs(k)%law)
    end do
    call text%close()
  contains
    !> One material or spring.
    subroutine one_law(kind, name, modulus, law)
      character(*), intent(in) :: kind, name
      character(*), intent(in) :: modulus      !! what it is called
      type(law_record), intent(in) :: law
      call text%item('  '//kind//' "{'//kind//'='//name//'}" at {temperature} C: times are {times 4} of those at '// &
        '{reference_temperature} C, '//modulus//' {modulus 4}', [law%temperature, law%slower, law%reference, law%stiffer])
    end subroutine one_law
  end subroutine temperature_lines

  !> States of the controllers, and how far the approximations of delays go.
  subroutine control_lines(m, text)
    type(mechanism_model), intent(in) :: m
    type(summary_record), intent(inout) :: text
    integer :: k
    call text%line('  controllers: {controllers #}, their states: {controller_states #}', &
                   [real(wp) :: size(m%s%controllers), sum(m%s%controllers%states)])
    call text%open('delay_limits', '{')
    do k = 1, size(m%s%controllers)
      associate (c => m%s%controllers(k))
        if (c%delay > 0.0_wp) call text%line('  note: the delay of controller "'//trim(c%name)//'" is its Pade approximation '// &
          'of order 3, whose phase errs by 5 degrees at {'//trim(c%name)//' 4} Hz and by more above', [delay_limit/(2*pi*c%delay)])
      end associate
    end do
    call text%close()
  end subroutine control_lines

  !> What damps a body: the number of dissipative coordinates with its reason, Rayleigh damping.
  function damping_words(d, b, k) result(text)
    type(deck), intent(in) :: d
    type(body_model), intent(in) :: b
    integer, intent(in) :: k
    character(:), allocatable :: text
    integer :: r, ghm, maxwell                 ! terms, at most
    if (b%nz > 0) then
      ghm = maxval([(b%segments(r)%law%second, r=1, size(b%segments))])
      maxwell = maxval([(b%segments(r)%law%first, r=1, size(b%segments))])
      text = to_text(b%nz)//' dissipative coordinates (one a '//either('mode and material', 'viscoelastic deformation', &
        b%basis%reduced_from > 0)//' and term, up to '//to_text(ghm)//' of GHM and '//to_text(maxwell)//' of Maxwell)'
    else if (d%bodies(k)%viscoelastic) then
      text = 'no dissipative coordinates (no viscoelastic terms in its materials)'
    else
      text = 'no dissipative coordinates (viscoelastic=.false., '
      if (d%bodies(k)%modulus_at > 0.0_wp) text = text//'modulus at '//to_text(d%bodies(k)%modulus_at)//' Hz)'
      if (.not. d%bodies(k)%modulus_at > 0.0_wp) text = text//'static modulus E_R)'
    end if
    if (b%rayleigh) text = text//', Rayleigh damping'
  end function damping_words

  !> The joints of redundant sets and what becomes of their reactions.
  function undetermined(m, report, most) result(text)
    type(mechanism_model), intent(in) :: m
    type(assembly_report), intent(in) :: report
    integer, intent(in) :: most                      !! joints that are named
    character(:), allocatable :: text
    character(32), allocatable :: names(:)
    integer :: k
    names = pack([(m%s%constraints(k)%item%name, k=1, size(m%s%constraints))], report%dependent)
    text = in_quotes(names(:min(most, size(names))))
    if (size(names) > most) text = text//' and '//to_text(size(names) - most)//' more'
    text = text//'; the reactions of these joints are not determined by rigid-body mechanics (minimum-norm values are reported)'
  end function undetermined

  !> Its warnings, one a line.
  function model_warnings(d, m, report) result(text)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    type(assembly_report), intent(in) :: report
    character(:), allocatable :: text
    integer :: k
    text = ''
    do k = 1, size(report%warnings)
      text = text//trim(report%warnings(k))//new_line('a')
    end do
    if (report%rank < m%s%permanent_rows) text = text//'redundant constraints at the start among'// &
                                                 undetermined(m, report, 3)//new_line('a')
    do k = 1, size(m%s%bodies)
      if (m%s%bodies(k)%extra_references > 0) text = text//'body "'//trim(m%s%bodies(k)%name)//'" has '// &
        to_text(m%s%bodies(k)%extra_references)//' reference conditions more than needed: stiffer than the structure'// &
        new_line('a')
      if (d%transient%present) text = text//weak_frame(m%s%bodies(k))
    end do
  end function model_warnings

  !> What makes masses uneven where a frame has no inertia of its own; empty where none is so.
  function weak_frames(m) result(text)
    type(mechanism_model), intent(in) :: m
    character(:), allocatable :: text
    integer :: k
    text = ''
    do k = 1, size(m%s%bodies)
      text = text//weak_frame(m%s%bodies(k))
    end do
    text = text(:index(text//new_line('a'), new_line('a')) - 1)   ! the first one
  end function weak_frames

  !> Warns where the frame stands at a node of a mesh so fine that rounding reaches the inertia with which it turns in a
  !> transient (theory.md, section 7); equilibria, modes and responses do not feel it. Empty elsewhere.
  function weak_frame(b) result(text)
    type(body_model), intent(in) :: b
    character(:), allocatable :: text
    real(wp), parameter :: least = 1.0e-8_wp         ! share of the inertia that keeps half of the digits [-]
    real(wp) :: y(b%nf), work(2, b%nf)               ! [m, -]
    text = ''
    if (.not. b%flexible) return
    y = b%shape%c0
    call b%basis%solve_mass(b%nf, work, y)
    if (b%i11 - dot_product(b%shape%c0, y) > least*b%i11) return
    text = 'body "'//trim(b%name)//'" is clamped at a node of so fine a mesh that rounding may spoil accelerations '// &
           'and reactions there; expected reference=''pinned'' or fewer elements'//new_line('a')
  end function weak_frame
end module summary
