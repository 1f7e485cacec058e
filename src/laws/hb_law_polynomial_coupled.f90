!> Polynomial of several degrees of freedom and their rates: each term c q_1**a_1 q_2**a_2 ... v_1**b_1 v_2**b_2 ...
!> acts on one of them. Terms come from lists, or from a text table with one term per line, such as the quadratic and
!> cubic tensors of reduced models of geometric nonlinearity; they are stored and evaluated by the few factors of
!> each. Source: docs/why/theory.md, section 5.1; M. P. Mignolet, A. Przekop, S. A. Rizzi and S. M. Spottswood, J.
!> Sound Vib. 332 (2013) 2437 (reduced models). Sign: f stands beside K q on the left-hand side.
module hb_law_polynomial_coupled
   use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
   use hb_checksum, only: checksum
   use hb_error, only: annotate, error_t, fail
   use hb_file_location, only: check_source
   use hb_kinds, only: wp
   use hb_law, only: law_t, read_dofs
   use hb_numbers, only: number_t, numbers_t
   use hb_properties, only: properties_t
   use hb_structure, only: structure_t
   use hb_system, only: beside
   use hb_text, only: parse_real, split, string_t, to_text
   use hb_text_file, only: read_text_file
   implicit none
   private
   public :: new_polynomial_coupled, polynomial_coupled_t

   integer, parameter :: block_size = 256                             ! samples at a time
   integer, parameter :: highest_exponent = 30
   character(*), parameter :: blanks = " "//achar(9)//achar(13)

   type, extends(law_t) :: polynomial_coupled_t
      integer :: n_coordinates = 0
      real(wp), allocatable :: coefficients(:)                        !! c, (n_terms)
      integer, allocatable :: acts_on(:)                              !! coordinate on which the term acts, (n_terms)
      integer, allocatable :: first(:)                                !! first factor of each term, and one more, (n_terms + 1)
      integer, allocatable :: factor(:)                               !! coordinate, or n_coordinates and the coordinate of a rate;
                                                                      !! ascending in each term, a power by repetition
      character(:), allocatable, private :: file_fingerprint          ! fingerprint of its file
   contains
      procedure :: read => polynomial_coupled_read
      procedure :: declare_numbers => polynomial_coupled_declare_numbers
      procedure :: derive => polynomial_coupled_derive
      procedure :: number_slope => polynomial_coupled_number_slope
      procedure :: evaluate => polynomial_coupled_evaluate
      procedure :: potential => polynomial_coupled_potential
      procedure :: fingerprint => polynomial_coupled_fingerprint
   end type polynomial_coupled_t

contains

   !> Creates a polynomial of the given terms.
   pure subroutine new_polynomial_coupled(self, coefficients, acts_on, z_exponents, v_exponents)
      class(polynomial_coupled_t), intent(inout) :: self
      real(wp), intent(in) :: coefficients(:)                         !! [N per product of powers], (n_terms)
      integer, intent(in) :: acts_on(:)                               !! (n_terms)
      integer, intent(in) :: z_exponents(:, :)                        !! (n_terms, n_coordinates), >= 0
      integer, intent(in) :: v_exponents(:, :)                        !! (n_terms, n_coordinates), >= 0
      integer :: exponents(2*size(z_exponents, 2)), i

      self%n_coordinates = size(z_exponents, 2)
      self%coefficients = coefficients
      self%acts_on = acts_on
      self%first = [1]
      self%factor = [integer ::]
      do i = 1, size(coefficients)
         exponents = [z_exponents(i, :), v_exponents(i, :)]
         self%factor = [self%factor, factors(exponents)]
         self%first = [self%first, size(self%factor) + 1]
      end do
      call self%derive()
   end subroutine new_polynomial_coupled

   !> Those of a table in a file are not numbers of the law.
   subroutine polynomial_coupled_declare_numbers(self, numbers)
      class(polynomial_coupled_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers

      if (.not. allocated(self%file_fingerprint)) call numbers%add("coefficients", self%coefficients)
   end subroutine polynomial_coupled_declare_numbers

   !> Factors of a term.
   pure function factors(exponents)
      integer, intent(in) :: exponents(:)
      integer, allocatable :: factors(:)
      integer :: c, k

      factors = [((c, k=1, exponents(c)), c=1, size(exponents))]
   end function factors

   !> Sets the properties that follow from the terms.
   pure subroutine polynomial_coupled_derive(self)
      class(polynomial_coupled_t), intent(inout) :: self

      associate (degrees => self%first(2:) - self%first(:size(self%first) - 1))
         self%degree = max(1, maxval(degrees))
         self%is_odd = all(modulo(degrees, 2) == 1 .or. abs(self%coefficients) <= 0.0_wp)
      end associate
      self%needs_velocity = any(self%factor > self%n_coordinates)
      self%has_potential = is_gradient(self)
   end subroutine polynomial_coupled_derive

   !> Reads a `&law type = 'polynomial_coupled'` group.
   subroutine polynomial_coupled_read(self, group, structure)
      class(polynomial_coupled_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      character(*), parameter :: lists(4) = [character(22) :: "coefficients", "acts_on", "displacement_exponents", &
                                             "velocity_exponents"]
      character(:), allocatable :: file
      type(error_t), allocatable :: error
      integer :: i

      self%has_potential = .true.                                     ! until determined
      call read_dofs(self, group, structure)
      call group%get("file", file, required=.false.)
      if (.not. allocated(file)) then
         call read_lists(self, group, structure)
         return
      end if
      do i = 1, size(lists)
         if (group%given(trim(lists(i)))) call group%problem(trim(lists(i)), "give either 'file' or lists of terms, not both")
      end do
      if (.not. allocated(self%dofs)) return
      call read_terms(self, trim(beside(group%file_name, file)), file, structure, error)
      if (allocated(error)) call group%problem("file", error%message)
   end subroutine polynomial_coupled_read

   !> Reads terms from lists of coefficients and exponents.
   subroutine read_lists(self, group, structure)
      class(polynomial_coupled_t), intent(inout) :: self
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      type(string_t), allocatable :: names(:)
      real(wp), allocatable :: coefficients(:)
      integer, allocatable :: acts_on(:), v_exponents(:, :), v_list(:), z_exponents(:, :), z_list(:)
      integer :: i

      call group%get("coefficients", coefficients, required=.true.)
      if (.not. (allocated(self%dofs) .and. allocated(coefficients))) return
      call group%get("acts_on", names, n=size(coefficients), required=.true.)
      allocate (z_list(size(coefficients)*size(self%dofs)), v_list(size(coefficients)*size(self%dofs)), source=0)
      call group%get("displacement_exponents", z_list)
      call group%get("velocity_exponents", v_list)
      call sort_by_term(group, "displacement_exponents", z_list, size(coefficients), size(self%dofs), z_exponents)
      call sort_by_term(group, "velocity_exponents", v_list, size(coefficients), size(self%dofs), v_exponents)
      if (.not. (allocated(names) .and. allocated(z_exponents) .and. allocated(v_exponents))) return
      if (size(names) /= size(coefficients)) return
      do i = 1, size(coefficients)
         if (all(z_exponents(i, :) == 0) .and. all(v_exponents(i, :) == 0)) then
            call group%problem("coefficients", "term "//to_text(i)//" has no exponent: a constant force is a &load of the "// &
                               "zero tuple")
         end if
      end do
      call find_coordinates(self, names, group, structure, acts_on)
      if (allocated(acts_on)) call new_polynomial_coupled(self, coefficients, acts_on, z_exponents, v_exponents)
   end subroutine read_lists

   !> Converts a list of exponents, term after term, to a table; not allocated if the length is wrong.
   subroutine sort_by_term(group, key, list, n_terms, n_dofs, exponents)
      type(properties_t), intent(inout) :: group
      character(*), intent(in) :: key
      integer, intent(in) :: list(:), n_terms, n_dofs
      integer, allocatable, intent(out) :: exponents(:, :)            !! (n_terms, n_dofs)

      if (size(list) == n_terms*n_dofs) then
         exponents = transpose(reshape(list, [n_dofs, n_terms]))
      else
         call group%problem(key, "give one exponent for each of the "//to_text(n_dofs)//" degrees of freedom and "// &
                            to_text(n_terms)//" terms, "//to_text(n_terms*n_dofs)//" in all, not "//to_text(size(list)))
      end if
   end subroutine sort_by_term

   !> Positions of the named degrees of freedom among those of the law; not allocated after a problem.
   subroutine find_coordinates(self, names, group, structure, positions)
      class(polynomial_coupled_t), intent(in) :: self
      type(string_t), intent(in) :: names(:)
      type(properties_t), intent(inout) :: group
      type(structure_t), intent(in) :: structure
      integer, allocatable, intent(out) :: positions(:)
      type(error_t), allocatable :: error
      integer :: dof, i

      allocate (positions(size(names)))
      do i = 1, size(names)
         call structure%find_dof(names(i)%value, dof, error)
         if (allocated(error)) then
            call group%problem("acts_on", error%message)
            deallocate (positions)
            return
         end if
         positions(i) = findloc(self%dofs, dof, dim=1)
         if (positions(i) == 0) then
            call group%problem("acts_on", "'"//names(i)%value//"' must be one of 'dofs' as well")
            deallocate (positions)
            return
         end if
      end do
   end subroutine find_coordinates

   !> Reads terms from a table: each line contains the coefficient, the degree of freedom on which the term acts, and
   !> those that are multiplied, as in `1.2e5 q1 q1 q1 q2`. Text after ! or # is a comment.
   subroutine read_terms(self, path, name, structure, error)
      class(polynomial_coupled_t), intent(inout) :: self
      character(*), intent(in) :: path
      character(*), intent(in) :: name                                !! of the file, as in the input
      type(structure_t), intent(in) :: structure
      type(error_t), allocatable, intent(out) :: error
      type(string_t), allocatable :: lines(:)
      character(:), allocatable :: text
      character(8) :: sum_of_bytes
      integer :: i, n

      call check_source(path, error)
      if (.not. allocated(error)) call read_text_file(path, text, error)
      if (allocated(error)) return
      write (sum_of_bytes, "(z8.8)") checksum(0, text)
      self%file_fingerprint = name//", CRC-32 "//sum_of_bytes//", "//to_text(len(text))//" bytes"
      call split(text, new_line("a"), lines)
      self%n_coordinates = size(self%dofs)
      allocate (self%coefficients(size(lines)), self%acts_on(size(lines)), self%first(size(lines) + 1), self%factor(len(text)))
      self%first(1) = 1
      n = 0
      do i = 1, size(lines)
         associate (line => lines(i)%value(:scan(lines(i)%value//"!", "!#") - 1))
            if (verify(line, blanks) == 0) cycle
            n = n + 1
            call read_term(self, line, n, structure, error)
         end associate
         call annotate(error, "'"//name//"', line "//to_text(i))
         if (allocated(error)) return
      end do
      self%coefficients = self%coefficients(:n)
      self%acts_on = self%acts_on(:n)
      self%first = self%first(:n + 1)
      self%factor = self%factor(:self%first(n + 1) - 1)
      if (n == 0) call fail(error, "'"//name//"' has no terms; a line each, such as '1.2e5 q1 q1 q1 q2'")
      call self%derive()
   end subroutine read_terms

   !> Reads one line of the table, without its comment.
   subroutine read_term(self, line, i, structure, error)
      class(polynomial_coupled_t), intent(inout) :: self
      character(*), intent(in) :: line
      integer, intent(in) :: i                                        !! number of the term
      type(structure_t), intent(in) :: structure
      type(error_t), allocatable, intent(out) :: error
      integer :: exponents(size(self%dofs)), c, last, n, start
      logical :: is_number

      exponents = 0
      n = 0
      last = 0
      do
         start = last + verify(line(last + 1:), blanks)
         if (start == last) exit
         last = start + scan(line(start:)//" ", blanks) - 2
         n = n + 1
         associate (word => line(start:last))
            if (n == 1) then
               call parse_real(word, self%coefficients(i), is_number)
               if (is_number) is_number = ieee_is_finite(self%coefficients(i))
               if (.not. is_number) call fail(error, "'"//word//"' is not a number; a line has a number, the degree of freedom "// &
                                              "on which the term acts, and those that are multiplied")
            else
               do c = size(self%dofs), 1, -1                          ! these first: there may be many others
                  if (structure%labels(self%dofs(c)) == word) exit
               end do
               if (c == 0) c = findloc(self%dofs, structure%dof_index(word), dim=1)
               if (c == 0) call fail(error, "'"//word//"' is not one of 'dofs'")
            end if
         end associate
         if (allocated(error)) return
         if (n == 2) self%acts_on(i) = c
         if (n > 2) exponents(c) = exponents(c) + 1
      end do
      if (n < 3) then
         call fail(error, "a term needs a number, the degree of freedom on which it acts, and at least one that is multiplied")
      else if (any(exponents > highest_exponent)) then
         call fail(error, "a degree of freedom occurs more than "//to_text(highest_exponent)//" times")
      end if
      self%first(i + 1) = self%first(i) + sum(exponents)
      self%factor(self%first(i):self%first(i + 1) - 1) = factors(exponents)
   end subroutine read_term

   !> Fingerprint of the file of the terms, if there is one.
   function polynomial_coupled_fingerprint(self) result(text)
      class(polynomial_coupled_t), intent(in) :: self
      character(300) :: text

      text = ""
      if (allocated(self%file_fingerprint)) text = self%file_fingerprint
   end function polynomial_coupled_fingerprint

   subroutine polynomial_coupled_evaluate(self, z, v, p, f, df_dz, df_dv, df_dp)
      class(polynomial_coupled_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: f(:, :)
      real(wp), intent(out), contiguous, optional :: df_dz(:, :, :), df_dv(:, :, :), df_dp(:, :, :)
      real(wp) :: value(block_size)
      integer :: begin, end, i, k

      f = 0.0_wp
      if (present(df_dz)) df_dz = 0.0_wp
      if (present(df_dv)) df_dv = 0.0_wp
      do begin = 1, size(z, 1), block_size
         end = min(begin + block_size - 1, size(z, 1))
         do i = 1, size(self%coefficients)
            associate (a => self%acts_on(i), f_i => value(1:end - begin + 1))
               call find_term(self, i, z(begin:end, :), v(begin:end, :), 0, f_i)
               f(begin:end, a) = f(begin:end, a) + f_i
               do k = self%first(i), self%first(i + 1) - 1
                  associate (c => self%factor(k), n => self%n_coordinates)
                     if (any(self%factor(self%first(i):k - 1) == c)) cycle
                     if (c <= n .and. present(df_dz)) then
                        call find_term(self, i, z(begin:end, :), v(begin:end, :), k, f_i)
                        df_dz(begin:end, a, c) = df_dz(begin:end, a, c) + f_i
                     else if (c > n .and. present(df_dv)) then
                        call find_term(self, i, z(begin:end, :), v(begin:end, :), k, f_i)
                        df_dv(begin:end, a, c - n) = df_dv(begin:end, a, c - n) + f_i
                     end if
                  end associate
               end do
            end associate
         end do
      end do
   end subroutine polynomial_coupled_evaluate

   subroutine polynomial_coupled_number_slope(self, number, z, v, p, slope, is_known)
      class(polynomial_coupled_t), intent(in) :: self
      type(number_t), intent(in) :: number
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)
      real(wp), intent(out), contiguous :: slope(:, :)
      logical, intent(out) :: is_known
      integer :: i, k

      is_known = .true.
      i = max(1, number%element(1))
      slope = 0.0_wp
      associate (value => slope(:, self%acts_on(i)), n => self%n_coordinates)
         value = 1.0_wp
         do k = self%first(i), self%first(i + 1) - 1
            if (self%factor(k) <= n) then
               value = value*z(:, self%factor(k))
            else
               value = value*v(:, self%factor(k) - n)
            end if
         end do
      end associate
   end subroutine polynomial_coupled_number_slope

   !> Term i, or its derivative with respect to the coordinate or rate of one of its factors (0: none).
   pure subroutine find_term(self, i, z, v, by_factor, value)
      class(polynomial_coupled_t), intent(in) :: self
      integer, intent(in) :: i, by_factor
      real(wp), intent(in) :: z(:, :), v(:, :)
      real(wp), intent(out) :: value(:)
      integer :: k

      associate (own => self%factor(self%first(i):self%first(i + 1) - 1), n => self%n_coordinates)
         value = self%coefficients(i)
         if (by_factor > 0) value = value*count(own == self%factor(by_factor))
         do k = self%first(i), self%first(i + 1) - 1
            if (k == by_factor) cycle
            if (self%factor(k) <= n) then
               value = value*z(:, self%factor(k))
            else
               value = value*v(:, self%factor(k) - n)
            end if
         end do
      end associate
   end subroutine find_term

   !> Whether the terms without a rate are a gradient: for the terms from one product of powers, those on each
   !> coordinate must satisfy Euler's theorem for their sum. Products are sorted by their exponents, coordinate by
   !> coordinate.
   pure logical function is_gradient(self)
      class(polynomial_coupled_t), intent(in) :: self
      real(wp), parameter :: digits = 1.0e-12_wp                      ! coefficients come from a file
      integer, allocatable :: exponents(:, :), order(:), sorted(:)
      real(wp) :: given(self%n_coordinates), largest, total
      integer :: b, e, first, i, k, last

      order = pack([(i, i=1, size(self%coefficients))], [(.not. has_rate(self, i), i=1, size(self%coefficients))])
      allocate (exponents(2*self%n_coordinates, size(self%coefficients)), source=0)
      do i = 1, size(self%coefficients)
         do k = self%first(i), self%first(i + 1) - 1
            exponents(self%factor(k), i) = exponents(self%factor(k), i) + 1
         end do
         exponents(self%acts_on(i), i) = exponents(self%acts_on(i), i) + 1
      end do
      do b = 1, self%n_coordinates
         allocate (sorted(0))
         do e = 0, maxval(exponents(b, :))
            sorted = [sorted, pack(order, exponents(b, order) == e)]
         end do
         call move_alloc(sorted, order)
      end do
      is_gradient = .true.
      first = 1
      do while (first <= size(order))
         associate (product => exponents(:self%n_coordinates, order(first)))
            given = 0.0_wp
            largest = 0.0_wp
            do last = first, size(order)
               if (any(exponents(:self%n_coordinates, order(last)) /= product)) exit
               associate (c => self%coefficients(order(last)), a => self%acts_on(order(last)))
                  given(a) = given(a) + c
                  largest = max(largest, abs(c))
               end associate
            end do
            total = sum(given)
            if (any(abs(product*total/sum(product) - given) > digits*largest)) is_gradient = .false.
         end associate
         first = last
      end do
   end function is_gradient

   pure logical function has_rate(self, i)
      class(polynomial_coupled_t), intent(in) :: self
      integer, intent(in) :: i

      has_rate = any(self%factor(self%first(i):self%first(i + 1) - 1) > self%n_coordinates)
   end function has_rate

   !> Sum of z_a c z**a/(degree + 1) over the terms without a rate, where a is the coordinate on which each acts: by
   !> Euler's theorem on homogeneous functions this is the potential, if there is one.
   subroutine polynomial_coupled_potential(self, z, energy, gradient)
      class(polynomial_coupled_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :)
      real(wp), intent(out) :: energy(:), gradient(:, :)
      real(wp) :: value(size(z, 1))
      integer :: i

      energy = 0.0_wp
      gradient = 0.0_wp
      do i = 1, size(self%coefficients)
         if (has_rate(self, i)) cycle
         call find_term(self, i, z, z, 0, value)
         associate (a => self%acts_on(i))
            energy = energy + z(:, a)*value/(self%first(i + 1) - self%first(i) + 1)
            gradient(:, a) = gradient(:, a) + value
         end associate
      end do
   end subroutine polynomial_coupled_potential
end module hb_law_polynomial_coupled
