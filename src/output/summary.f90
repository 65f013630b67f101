!> The model part of the summary and of --check: what was modelled and why, and what it costs.
module summary
  use kinds, only: wp
  use assembly_reports, only: assembly_report
  use body, only: body_model
  use controller, only: delay_limit
  use deck_records, only: deck
  use mechanism, only: mechanism_model
  use posix, only: tell
  use summary_text, only: json_number, summary_record
  use readable_text, only: json_text, one_line
  use text, only: either, joined, short_text, to_text
  implicit none (type, external)
  private
  public :: model_lines, model_warnings, version, add_warnings, tell_warnings

  character(*), parameter :: version = '0.1.0'   !! of the program

contains

  !> Adds lines of warnings to a summary and writes them to standard error.
  subroutine add_warnings(text, path, warnings)
    type(summary_record), intent(inout) :: text
    character(*), intent(in) :: path
    character(*), intent(in) :: warnings       !! each ends with a new line
    call text%words%add(warnings)
    call tell_warnings(text, path, warnings)
  end subroutine add_warnings

  !> Writes warnings to standard error with the deck's path, and adds them to the summary's list.
  subroutine tell_warnings(text, path, warnings)
    type(summary_record), intent(inout) :: text
    character(*), intent(in) :: path
    character(*), intent(in) :: warnings       !! lines `warning: ...`, each ends with a new line
    integer :: from, to
    from = 1
    do while (from <= len(warnings))
      to = from + index(warnings(from:), new_line('a')) - 2
      if (text%silent) then
        call text%held_back%add(path//': '//warnings(from:to)//new_line('a'))
      else
        call tell(path//': '//warnings(from:to))
      end if
      call text%warning(warnings(from + len('warning: '):to))
      from = to + 2
    end do
  end subroutine tell_warnings

  !> What was modelled: bodies and their coordinates, constraints, degrees of freedom, redundant joints.
  subroutine model_lines(d, m, report, text)
    type(deck), intent(in) :: d
    type(mechanism_model), intent(in) :: m
    type(assembly_report), intent(in) :: report
    type(summary_record), intent(inout) :: text
    integer :: k
    call text%member('version', json_text(version))
    call text%figure('deck: ', 'deck', d%name, '')
    if (len(d%scene%title) > 0) call text%line('title: '//one_line(d%scene%title))
    call text%member('title', json_text(d%scene%title))
    if (size(d%parameters) > 0) then
      call text%open('parameters', '{')
      do k = 1, size(d%parameters)
        call text%member(trim(d%parameters(k)%name), json_number(d%parameters(k)%value))
      end do
      call text%close()
    end if
    call text%line('')
    call text%line('model')
    call text%open('model', '{')
    call text%open('bodies', '[')
    do k = 1, size(m%s%bodies)
      call body_line(m%s%bodies(k), k)
    end do
    call text%close()
    call text%figure('  coordinates: ', 'frame_coordinates', 3*size(m%s%bodies))
    call text%figure(' of frames + ', 'elastic_coordinates', m%s%nq - 3*size(m%s%bodies))
    call text%figure(' elastic = ', 'coordinates', m%s%nq, '')
    associate (terms => m%s%nz - sum(m%s%controllers%states))
      call text%figure('  dissipative coordinates: ', 'dissipative_coordinates', terms)
      if (m%s%nzd < terms) call text%figure(', of first order: ', 'dissipative_coordinates_of_first_order', terms - m%s%nzd)
    end associate
    call text%line('')
    if (size(m%s%controllers) > 0) call control_lines(m, text)
    call text%figure('  constraints (multipliers): ', 'constraints', m%s%permanent_rows)
    call text%figure(', independent at the start: ', 'independent_constraints', report%rank, '')
    call text%figure('  degrees of freedom: ', 'degrees_of_freedom', report%freedoms, '')
    call redundancy()
    call frame_notes(m, text)
    do k = 1, size(report%warnings)
      call text%line('  warning: '//trim(report%warnings(k)))
    end do
    call text%close()
  contains
    !> One body: which coordinates it has, and why.
    subroutine body_line(b, k)
      type(body_model), intent(in) :: b
      integer, intent(in) :: k
      character(:), allocatable :: kind
      logical :: modal
      call text%open('', '{')
      call text%figure('  body "', 'name', trim(b%name))
      kind = trim(d%bodies(k)%kind)
      if (.not. b%flexible) then
        call text%figure('": ', 'model', 'rigid')
        call text%member('kind', json_text(kind))
        call text%words%add(', 3 coordinates')
        if (kind /= 'rigid') call text%words%add(' ('//kind//' with flexible=.false.)')
        call text%line('')
        call text%close()
        return
      end if
      modal = b%basis%reduced_from > 0
      call text%member('model', json_text(merge('modal', 'nodal', modal)))
      call text%figure('": ', 'kind', kind)
      call text%figure(' of ', 'elements', b%ne)
      call text%figure(' elements, reference ', 'reference', trim(d%bodies(k)%reference))
      call text%figure(', 3 + ', 'elastic_coordinates', b%nf)
      if (modal) then
        call text%words%add(' modes')
        if (d%bodies(k)%static_shapes) then
          call text%figure(', ', 'static_shapes', b%basis%static_shapes)
          call text%words%add(' of them static shapes,')
        end if
        call text%figure(' of ', 'nodal_coordinates', b%basis%reduced_from)
        call text%words%add(' nodal coordinates')
      else
        call text%words%add(' elastic coordinates ('//to_text(3*b%nn)//' nodal ones')
        if (.not. b%axial) call text%words%add(' without the axial ones')
        call text%words%add(' less the reference conditions)')
      end if
      if (modal .and. .not. b%axial) call text%words%add(', no axial deformation')
      if (b%stiffening) call text%words%add(', geometric stiffening')
      call text%member('dissipative_coordinates', to_text(b%nz))
      call text%figure(', ', 'damping', damping_words(d, b, k))
      if (b%extra_references > 0) call text%words%add('; '//to_text(b%extra_references)// &
                                               ' reference conditions more than needed: stiffer than the structure')
      call text%line('')
      call text%close()
    end subroutine body_line

    !> Names the joints of redundant sets.
    subroutine redundancy()
      if (report%rank == m%s%permanent_rows) return
      call text%figure('  redundant constraints: ', 'redundant_constraints', m%s%permanent_rows - report%rank, &
                       ' at the start, among'//undetermined(m, report, size(report%dependent)))
    end subroutine redundancy
  end subroutine model_lines

  !> States of the controllers, and how far the approximations of delays go.
  subroutine control_lines(m, text)
    type(mechanism_model), intent(in) :: m
    type(summary_record), intent(inout) :: text
    integer :: k
    call text%figure('  controllers: ', 'controllers', size(m%s%controllers))
    call text%figure(', their states: ', 'controller_states', sum(m%s%controllers%states), '')
    do k = 1, size(m%s%controllers)
      associate (c => m%s%controllers(k))
        if (.not. c%delay > 0.0_wp) cycle
        call text%line('  note: the delay of controller "'//trim(c%name)//'" is its Pade approximation of order 3, whose phase '// &
                       'errs by 5 degrees at '//short_text(delay_limit(c%delay), 4)//' Hz and by more above')
      end associate
    end do
  end subroutine control_lines

  !> What damps a body: the number of dissipative coordinates with its reason, Rayleigh damping.
  function damping_words(d, b, k) result(text)
    type(deck), intent(in) :: d
    type(body_model), intent(in) :: b
    integer, intent(in) :: k
    character(:), allocatable :: text
    character(14) :: kind                      ! of the terms
    integer :: r, ghm, maxwell, elements
    ghm = 0
    maxwell = 0
    elements = 0
    do r = 1, size(b%segments)
      ghm = max(ghm, b%segments(r)%law%second)
      maxwell = max(maxwell, b%segments(r)%law%first)
      elements = elements + b%segments(r)%last - b%segments(r)%first + 1
    end do
    kind = merge('GHM           ', 'Maxwell       ', maxwell == 0)
    if (ghm > 0 .and. maxwell > 0) kind = 'GHM or Maxwell'
    if (b%nz > 0 .and. b%basis%reduced_from > 0) then
      text = to_text(b%nz)//' dissipative coordinates (one a mode, viscoelastic material and '//trim(kind)//' term)'
    else if (b%nz > 0) then
      text = to_text(b%nz)//' dissipative coordinates ('//to_text(elements)//' viscoelastic elements, '//to_text(b%nd)// &
             ' deformations each, '//to_text(ghm + maxwell)//' '//trim(kind)//either(' term)', ' terms)', ghm + maxwell == 1)
    else if (d%bodies(k)%viscoelastic) then
      text = 'no dissipative coordinates (no viscoelastic terms in its materials)'
    else
      text = 'no dissipative coordinates (viscoelastic=.false., '
      if (d%bodies(k)%modulus_at > 0.0_wp) text = text//'modulus at '//to_text(d%bodies(k)%modulus_at)//' Hz)'
      if (.not. d%bodies(k)%modulus_at > 0.0_wp) text = text//'static modulus E_R)'
    end if
    text = trim(text)
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
    text = ' "'//joined(names(:min(most, size(names))), '" "')//'"'
    if (size(names) > most) text = text//' and '//to_text(size(names) - most)//' more'
    text = text//'; the reactions of these joints are not determined by rigid-body mechanics (minimum-norm values are reported)'
  end function undetermined

  !> The warnings of the model's part of the summary, one line each.
  function model_warnings(m, report) result(text)
    type(mechanism_model), intent(in) :: m
    type(assembly_report), intent(in) :: report
    character(:), allocatable :: text
    integer :: k
    text = ''
    do k = 1, size(report%warnings)
      text = text//'warning: '//trim(report%warnings(k))//new_line('a')
    end do
    if (report%rank < m%s%permanent_rows) text = text//'warning: redundant constraints at the start among'// &
                                                 undetermined(m, report, 3)//new_line('a')
    do k = 1, size(m%s%bodies)
      if (m%s%bodies(k)%extra_references > 0) text = text//'warning: body "'//trim(m%s%bodies(k)%name)//'" has '// &
        to_text(m%s%bodies(k)%extra_references)//' reference conditions more than needed: stiffer than the structure'// &
        new_line('a')
      text = text//weak_frame(m%s%bodies(k))
    end do
  end function model_warnings

  !> Warns where the frame stands at a node of a mesh so fine that rounding reaches the inertia with which it turns (theory.md,
  !> section 7); empty elsewhere.
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
    text = 'warning: body "'//trim(b%name)//'" is clamped at a node of so fine a mesh that rounding may spoil accelerations '// &
           'and reactions there; expected reference=''pinned'' or fewer elements'//new_line('a')
  end function weak_frame

  !> Says where a gear, drive, torque or torsional spring acts on the frame of a flexible body.
  subroutine frame_notes(m, text)
    type(mechanism_model), intent(in) :: m
    type(summary_record), intent(inout) :: text
    logical :: acts(6)
    character(:), allocatable :: what
    integer :: k
    do k = 1, m%s%permanent
      associate (c => m%s%constraints(k)%item)
        acts = c%acts_on()
        what = either('joint', 'drive', k <= m%s%joints)//' "'//trim(c%name)//'"'
        if (acts(3)) call note(c%ia, what)
        if (acts(6)) call note(c%ib, what)
        if (c%ic > 0) call note(c%ic, what)
      end associate
    end do
    do k = 1, size(m%s%forces)
      associate (f => m%s%forces(k)%item)
        call note(f%ia, trim(f%group)//' "'//trim(f%name)//'"')
        if (f%ib /= f%ia) call note(f%ib, trim(f%group)//' "'//trim(f%name)//'"')
      end associate
    end do
  contains
    !> Adds the line if the marker is the frame of a flexible body.
    subroutine note(marker, what)
      integer, intent(in) :: marker
      character(*), intent(in) :: what
      integer :: b
      b = m%s%markers(marker)%body
      if (b == 0 .or. m%s%markers(marker)%node > 0) return
      if (.not. m%s%bodies(b)%flexible) return
      call text%line('  note: '//what//' acts on the frame of flexible body "'//trim(m%s%bodies(b)%name)// &
                    '", whose angle depends on its reference conditions')
    end subroutine note
  end subroutine frame_notes
end module summary
